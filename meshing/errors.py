"""The meshing subsystem's named exception."""


class MeshingError(RuntimeError):
    """No usable mesh could be made; the message says which step failed and why."""
