"""Exceptions of the package."""


class Error(Exception):
    """Base class of all errors of trilink; its message is that of the program."""


class ConfigError(Error, ValueError):
    """Invalid `pipeline.toml`, `trials.toml` or argument; the message names the key or argument, and what is needed."""


class TableError(Error, ValueError):
    """A table or other file that cannot be read or written, or an invalid column or condition."""


class BusyError(Error):
    """Another run is writing the same results; `wait=True` waits for its end."""


class Caution(UserWarning):
    """A result that should be used with caution, such as one computed from a fit that does not fit."""


for _class in (Error, ConfigError, TableError, BusyError, Caution):
    _class.__module__ = "trilink"
