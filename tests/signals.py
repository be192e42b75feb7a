"""Signals as a process has them that was started at a terminal, however the tests were started."""

import signal


def default_signals() -> None:
    """Heed signals that ``nohup``, or a shell that starts a job in the background, has ignored."""
    for name in ("SIGINT", "SIGHUP", "SIGTERM"):
        signal.signal(getattr(signal, name), signal.SIG_DFL)
