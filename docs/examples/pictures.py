"""Draw every picture of the guide that needs no run: `python docs/examples/pictures.py docs/figures`."""

import sys
from collections.abc import Callable
from pathlib import Path

import blending
import greedy_centres
import greedy_rules
import mean_ratio
import motions
import point_cloud
import tail_root
from matplotlib.figure import Figure

PICTURES: dict[str, Callable[[], Figure]] = {
    "point_cloud": point_cloud.draw,
    "greedy_centres": greedy_centres.draw,
    "greedy_rules": greedy_rules.draw,
    "blending": blending.draw,
    "tail_root": tail_root.draw,
    "mean_ratio": mean_ratio.draw,
    **{f"motion_{name}": draw for name, draw in motions.PICTURES.items()},
}


def main(folder: Path) -> None:
    """Write the pictures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        draw().savefig(folder / f"{name}.png", dpi=100)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
