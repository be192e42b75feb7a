"""The argument parser: short errors that suggest what was meant."""

import contextlib
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from raytrace.cli import streams
from raytrace.errors import printable, shortened

LONGEST = 1000  # most characters of a message about an argument


class Parser(ArgumentParser):
    """An argument parser that can print its help and errors to any stream.

    Parameters
    ----------
    program : str
        What is typed before the arguments.
    about : str
        What the command does.
    """

    def __init__(self, program: str, about: str) -> None:
        super().__init__(
            prog=program, description=about, formatter_class=RawDescriptionHelpFormatter, allow_abbrev=False
        )

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Namespace:  # type: ignore[override]
        """Parse the arguments; an unknown option gets a suggestion."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            word = next((word for word in unknown if word.startswith("-")), "").partition("=")[0]
            known = [name for action in self._actions for name in action.option_strings if name.startswith("--")]
            meant = suggestion(word, known) if word else ""
            self.error(f"unrecognized arguments: {' '.join(unknown)}{meant}")
        return found

    def error(self, message: str) -> NoReturn:
        """Print what is required and what is wrong; exit with code 2."""
        formatter = self._get_formatter()
        formatter.add_usage(None, [action for action in self._actions if action.required], [])
        usage = formatter.format_help().strip().replace(self.prog, f"{self.prog} [options]", 1)
        with contextlib.suppress(OSError):  # the reader is gone
            self._print_message(f"{usage}    (all options: {self.prog} --help)\n", sys.stderr)
        self.exit(2, f"{self.prog}: error: {shortened(printable(message), LONGEST)}")

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """Flush the output, such as the help, and exit."""
        if message:
            streams.say(message.rstrip())
        streams.flush()
        sys.exit(status)


def suggestion(word: str, known: Iterable[str]) -> str:
    """Suggest the known word that is closest, as the end of a message; "" where none is close.

    >>> suggestion("sobl", ["sobol", "stratified"])
    "; did you mean 'sobol'?"
    """
    from difflib import get_close_matches

    return "".join(f"; did you mean '{match}'?" for match in get_close_matches(word, list(known), 1))
