"""Commands over several scenes: one after the other, in one process."""

from argparse import Namespace
from collections.abc import Callable

from raytrace.cli import streams
from raytrace.cli.failures import DONE, failed
from raytrace.cli.terminal import INTERRUPTED
from raytrace.errors import printable


def each_scene(
    args: Namespace,
    run: Callable[[Namespace], int],
    stopped: Callable[[], bool] = lambda: False,
    title: bool = False,
    done: str = "done",
) -> int:
    """Run a command for every scene of its arguments; a scene that fails does not end the others.

    Parameters
    ----------
    args : Namespace
        With ``scenes``, a list of paths. The command gets them one by one, as ``scene``.
    run : callable
        The command; returns its exit code.
    stopped : callable
        Whether the user wants no further scenes.
    title : bool
        Whether to print number and name of each scene on stderr.
    done : str
        What the last message calls a scene that did not fail.

    Returns
    -------
    int
        The code of the first scene that failed; 130 after an interrupt.
    """
    each = [Namespace(**vars(args) | {"scene": path}) for path in args.scenes]
    if len(each) == 1:
        return run(each[0])
    codes: list[int] = []
    interrupted = False
    for number, one in enumerate(each, 1):
        if title:
            streams.say(printable(f"{number}/{len(each)} {one.scene}"))
        try:
            codes.append(run(one))
            interrupted = stopped()
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001, it becomes a line and an exit code
            codes.append(failed(error, printable(one.scene)))
            interrupted = isinstance(error, KeyboardInterrupt) or stopped()
        if interrupted:
            break
    wrong = [(str(one.scene), code) for one, code in zip(each, codes, strict=False) if code != DONE]
    if wrong or interrupted:
        parts = {
            f"not {done}": [scene for scene, _ in wrong],
            "not begun": [str(one.scene) for one in each[len(codes) :]],
        }
        begin = f"{len(codes) - len(wrong)} of {len(each)} scenes {done}"
        listed = [f"{what}: {', '.join(scenes)}" for what, scenes in parts.items() if scenes]
        streams.say(printable("; ".join([begin, *listed])))
    return INTERRUPTED if interrupted else next((code for _, code in wrong), DONE)
