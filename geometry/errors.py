"""The geometry subsystem's named exception."""


class CadError(RuntimeError):
    """The CAD kernel gave no usable solid, or the solid cannot be meshed; the message names the place."""
