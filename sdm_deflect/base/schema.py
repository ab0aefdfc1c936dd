"""Settings as annotated fields of dataclasses, each defined once.

    tolerance: Annotated[float, Doc("Accuracy", "Largest error at a data site, a length."), Range(0.0)] = 0.0

These annotations give the commands' options, the keys of settings files, Python's keywords with types and
documentation, and the table of the guide.
"""

from collections.abc import Callable, Iterable
from dataclasses import MISSING, Field, dataclass, fields, replace
from functools import cache
from math import inf
from numbers import Integral, Real
from textwrap import fill
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from .errors import InputError, shortened

N = TypeVar("N")

Group = Literal[
    "What moves", "Blended", "Track", "Slot", "Root", "Mirror", "What stays", "Box", "Repair", "Accuracy", ""
]  # fmt: skip
# Groups of settings in the order shown; settings of the aircraft have no group.
GROUPS: tuple[Group, ...] = get_args(Group)[:-1]
# Annotation of an inner dataclass whose settings stand beside those of the outer one.
INLINE = "inline"


@dataclass(frozen=True, slots=True)
class Doc:
    """The meaning of a setting.

    Attributes
    ----------
    group : group in which it is shown.
    text : a sentence or two, for the command line.
    more : further sentences, for Python's documentation and the guide.
    """

    group: Group
    text: str
    more: str = ""


@dataclass(frozen=True, slots=True)
class Range:
    """The range of a number.

    Attributes
    ----------
    low, high : least and largest value.
    above : whether `low` itself is excluded.
    unit : unit, for messages.
    """

    low: float = -inf
    high: float = inf
    above: bool = False
    unit: str = ""

    def __str__(self) -> str:
        if self.high == inf:
            return f"{'above' if self.above else 'of at least'} {self.with_unit(self.low)}"
        return f"{'above' if self.above else 'from'} {self.low:g} to {self.with_unit(self.high)}"

    def with_unit(self, value: float) -> str:
        """Return a number with its unit as text."""
        return f"{value:g} {self.unit}".rstrip()

    def holds(self, value: float) -> bool:
        """Return whether a finite number is in the range."""
        return self.low <= value <= self.high and abs(value) < inf and not (self.above and value == self.low)


@dataclass(frozen=True, slots=True)
class Option:
    """The command-line option of a setting.

    Attributes
    ----------
    flag : name of the option; empty for two dashes and the setting's name; None for ``--set`` only.
    metavar : placeholder for the value in the help; empty for its type.
    """

    flag: str | None = ""
    metavar: str = ""


ONLY_SET = Option(None)


@dataclass(frozen=True, slots=True)
class Spelling:
    """Another way to write a setting.

    Attributes
    ----------
    name : name of the setting, if it is not the field's.
    read : turns the user's value into the field's; InputError with the text after the setting's name and ``=``.
    file : suffix of values that are file names, relative to the settings file; None if values are no file names.
    """

    name: str = ""
    read: Callable[[Any], Any] | None = None
    file: str | None = None


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a dataclass, or of a dataclass inline in it.

    Attributes
    ----------
    name : name for users.
    path : fields that lead to the value.
    kind : type of the value.
    default : default value, or `dataclasses.MISSING`.
    notes : the annotations.
    """

    name: str
    path: tuple[str, ...]
    kind: Any
    default: Any
    notes: tuple[Any, ...]

    def note(self, kind: type[N]) -> N | None:
        """Return the annotation of a class, or None."""
        return next((note for note in self.notes if isinstance(note, kind)), None)

    @property
    def spelling(self) -> Spelling:
        """Its spelling by users."""
        return self.note(Spelling) or Spelling()

    @property
    def doc(self) -> Doc:
        """Its meaning; empty for tables of surfaces."""
        return self.note(Doc) or Doc("What moves", "")

    @property
    def option(self) -> Option:
        """Its option on the command line."""
        return self.note(Option) or Option()

    @property
    def default_text(self) -> str:
        """Its default as shown to users; empty without one."""
        if self.default is MISSING or self.default in (None, (), {}):
            return ""
        return ", ".join(self.default) if isinstance(self.default, tuple) else str(self.default)

    def of(self, instance: Any) -> Any:
        """Return its value in an instance of the dataclass."""
        for name in self.path:
            instance = getattr(instance, name)
        return instance


def _settings(kind: Any) -> dict[str, Setting]:
    flat: dict[str, Setting] = {}
    inner: dict[str, Setting] = {}
    for field, of, notes in _annotations(kind):
        if INLINE in notes:
            for name, setting in settings_in(of).items():
                inner[name] = replace(setting, path=(field.name, *setting.path))
        else:
            default = field.default if field.default_factory is MISSING else field.default_factory()
            setting = Setting(field.name, (field.name,), of, default, notes)
            name = setting.spelling.name or field.name
            flat[name] = replace(setting, name=name)
    return flat | inner


# Settings of a dataclass by name; those of inline dataclasses come last.
settings_in: Callable[[Any], dict[str, Setting]] = cache(_settings)


def inline_in(kind: Any) -> dict[str, Any]:
    """Return the inline dataclasses of a dataclass, by field."""
    return {field.name: of for field, of, notes in _annotations(kind) if INLINE in notes}


def _annotations(kind: Any) -> list[tuple[Field[Any], Any, tuple[Any, ...]]]:
    hints = get_type_hints(kind, include_extras=True)
    parts = {name: get_args(hint) if get_origin(hint) is Annotated else (hint,) for name, hint in hints.items()}
    return [
        (field, parts[field.name][0], (*parts[field.name][1:], *field.metadata.get("notes", ())))
        for field in fields(kind)
        if field.init
    ]


def check_settings(instance: Any) -> None:
    """Check the values of a dataclass in its ``__post_init__``; InputError names the first one out of range."""
    for name, setting in settings_in(type(instance)).items():
        within, value, choices = setting.note(Range), setting.of(instance), choices_of(setting.kind)
        if choices and isinstance(value, str) and value not in choices:
            raise InputError(f"{name} = {shortened(value)} must be {' or '.join(choices)}")
        kind, what = (Integral, "a whole number") if kind_of(setting.kind) is int else (Real, "a number")
        number = isinstance(value, kind) and not isinstance(value, bool)
        if within and not (number and within.holds(value)):
            given = within.with_unit(value) if number else shortened(value)
            raise InputError(f"{name} = {given} must be {what} {within}")


def kind_of(kind: Any) -> Any:
    """Return the type to which text is converted: the type itself, or the first of a union."""
    return get_args(kind)[0] if get_origin(kind) in (Union, UnionType) else kind


def choices_of(kind: Any) -> tuple[str, ...]:
    """Return the allowed words of a text setting."""
    return get_args(kind_of(kind)) if get_origin(kind_of(kind)) is Literal else ()


def describe(settings: Iterable[Setting], indent: str) -> str:
    """Return the meaning of settings by group, for a docstring."""
    parts = []
    for group in GROUPS:
        lines = [_line(setting) for setting in settings if setting.doc.group == group]
        items = (fill(line, 118, initial_indent=f"{indent}- ", subsequent_indent=f"{indent}  ") for line in lines)
        parts.append("\n".join([f"{indent}{group}:", "", *items]) if lines else "")
    return "\n\n".join(filter(None, parts)).lstrip()


def _line(setting: Setting) -> str:
    default = f" Default: ``{setting.default_text}``." if setting.default_text else ""
    return f"`{setting.name}`: {setting.doc.text} {setting.doc.more}".rstrip() + default
