"""The compiled part: requests and answers are JSON."""

from collections.abc import Callable

__version__: str

class Error(Exception):
    """What trilink could not do, and why."""

class ConfigError(Error):
    """`pipeline.toml`, `trials.toml` or an argument: which key, what was found, what was needed."""

class TableError(Error):
    """A table or another file that cannot be read or written, or a column or condition that is none."""

class BusyError(Error):
    """Another run is busy with the same results."""

def main(line: list[str]) -> int: ...
def run(request: str) -> str: ...
def read(request: str) -> tuple[str, str, int, Callable[[], object]]: ...
def simulate(request: str) -> tuple[str, list[tuple[list[str], bytearray] | None]]: ...
