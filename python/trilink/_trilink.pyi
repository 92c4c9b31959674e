"""Compiled part of the package `trilink`; its functions take requests and return results as JSON."""

from collections.abc import Callable

__version__: str

class Error(Exception):
    """Base class for all errors raised by trilink."""

class ConfigError(Error):
    """Invalid `pipeline.toml`, `trials.toml` or argument; the message names the key."""

class TableError(Error):
    """A table or other file that cannot be read or written, or an invalid column or condition."""

class BusyError(Error):
    """Another run is writing the same results."""

def main(line: list[str]) -> int: ...
def run(request: str) -> str: ...
def read(request: str) -> tuple[str, str, int, Callable[[], object]]: ...
def simulate(request: str) -> tuple[str, list[tuple[list[str], bytearray] | None]]: ...
