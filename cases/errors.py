"""What the command line answers with one line instead of a traceback."""


class InputError(ValueError):
    """A parameter, name or file that the user gave cannot be used."""


def is_reported(error: Exception) -> bool:
    """True for errors whose message tells the user what is wrong; any other exception is a defect of ours."""
    from cases.confine import ConfinementError
    from cases.output import OutputError
    from deform.interpolant import SolveError
    from geometry.errors import CadError
    from meshing.errors import MeshingError
    from meshing.formats.format import MeshFileError
    from meshing.vtu import FormatError

    return isinstance(
        error,
        InputError
        | ConfinementError
        | OutputError
        | SolveError
        | CadError
        | MeshingError
        | FormatError
        | MeshFileError,
    )
