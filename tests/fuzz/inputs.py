"""What a program is given: files and words; made, kept in folders and read back."""

import json
from dataclasses import dataclass, field
from pathlib import Path

WORDS = "words.json"


@dataclass(frozen=True, slots=True)
class Input:
    """Files by their path in an empty folder, and the words of a command.

    Attributes
    ----------
    files : content by path, the first one's first part is what is read.
    words : of the command line, where there is one.
    """

    files: dict[str, bytes] = field(default_factory=dict, repr=False)
    words: tuple[str, ...] = ()

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

    def keep(self, folder: Path) -> None:
        """Write files and words, so that `kept` has them again."""
        self.put(folder)
        text = json.dumps({"words": self.words, "files": list(self.files)}, indent=1)
        (folder / WORDS).write_text(text, encoding="utf-8", errors="surrogateescape")

    @classmethod
    def kept(cls, folder: Path) -> "Input":
        """Return what `keep` wrote."""
        given = json.loads((folder / WORDS).read_text(encoding="utf-8", errors="surrogateescape"))
        return cls({name: (folder / name).read_bytes() for name in given["files"]}, tuple(given["words"]))

    def with_file(self, name: str, content: bytes) -> "Input":
        """Return it with other content of a file."""
        return Input({**self.files, name: content}, self.words)


def of_path(path: Path, words: tuple[str, ...] = ()) -> Input:
    """Return a file, or all files of a folder, as an input."""
    if path.is_file():
        return Input({path.name: path.read_bytes()}, words)
    found = {
        str(file.relative_to(path.parent)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()
    }
    return Input(found, words)
