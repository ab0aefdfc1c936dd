"""What the command line answers with one line instead of a traceback."""

from sdm_deflect.base.errors import InputError, LostError


def is_reported(error: Exception) -> bool:
    """True for errors whose message tells the user what is wrong; any other exception is a defect of ours."""
    if isinstance(error, InputError | LostError):
        return True
    from sdm_deflect.base.errors import MeshFileError
    from sdm_deflect.cases.run.output import OutputError
    from sdm_deflect.deform.rbf.interpolant import SolveError
    from sdm_deflect.geometry.quantity import CadError
    from sdm_deflect.meshing.child import MeshingError

    return isinstance(error, OutputError | SolveError | CadError | MeshingError | MeshFileError)
