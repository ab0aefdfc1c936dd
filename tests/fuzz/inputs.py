"""What a reader is given: files, made and read back."""

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Input:
    """Files: content by their path in an empty folder; the first one's first part is what is read."""

    files: dict[str, bytes] = field(default_factory=dict, repr=False)

    @property
    def main(self) -> str:
        """The file or folder that is read."""
        return next(iter(self.files), "").partition("/")[0]

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(map(len, self.files.values()))

    def put(self, folder: Path) -> None:
        """Write the files into a folder."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)

    def with_file(self, name: str, content: bytes) -> "Input":
        """Return it with other content of a file."""
        return Input({**self.files, name: content})


def of_path(path: Path) -> Input:
    """Return a file, or all files of a folder, as an input."""
    if path.is_file():
        return Input({path.name: path.read_bytes()})
    files = (file for file in sorted(path.rglob("*")) if file.is_file())
    return Input({str(file.relative_to(path.parent)): file.read_bytes() for file in files})
