"""The error tree of irsd. Expected outcomes (not found, ambiguous) are values, never exceptions.

IrsdError
 +- ConfigError      a setting is unknown, of the wrong type or out of range
 +- DecodeError      sensor bytes that are not what their key says
 +- EditError        an operator's edit or command can't be done
 +- ModelError       a model file is missing, altered or breaks its contract
 |   +- RunCancelledError  a run was told to stop before its end
 +- StoreError       the state on disk can't be read or written
 +- TransportError   zenoh can't be opened, or a peer answered with an error
"""


class IrsdError(Exception):
    """Root of every error that irsd raises on purpose; the message says what to do."""


class ConfigError(IrsdError):
    """A setting is unknown, of the wrong type or out of range. Names file, key, value and range."""


class DecodeError(IrsdError):
    """A message's bytes can't be what its type says. The message is counted and dropped."""


class EditError(IrsdError):
    """An operator's edit or command can't be done as asked."""


class ModelError(IrsdError):
    """A model file is missing, fails its checksum or breaks its input/output contract."""


class RunCancelledError(ModelError):
    """A run was told to stop before its end; the session stays usable."""


class StoreError(IrsdError):
    """The state directory can't be read or written, or holds another map."""


class TransportError(IrsdError):
    """zenoh can't be opened as configured, or a peer answered with an error."""
