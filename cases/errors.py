"""Errors that the command line reports in one line instead of a traceback."""

from sdm_deflect.base.errors import InputError, LostError


def is_reported(error: Exception) -> bool:
    """Return whether an error's message is meant for the user; any other exception is a defect of the program."""
    if isinstance(error, InputError | LostError):
        return True
    from sdm_deflect.base.errors import MeshFileError
    from sdm_deflect.cases.run.output import OutputError
    from sdm_deflect.deform.rbf.interpolant import SolveError
    from sdm_deflect.geometry.quantity import CadError
    from sdm_deflect.meshing.child import MeshingError

    return isinstance(error, OutputError | SolveError | CadError | MeshingError | MeshFileError)
