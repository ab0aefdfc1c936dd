"""Numbers in sentences."""


def percent(share: float, digits: int = 0) -> str:
    """Return a share in per cent, with a space before the sign."""
    return f"{100.0 * share:.{digits}f} %"


def apart(value: float, limit: float, digits: int = 3) -> tuple[str, str]:
    """Return two numbers as texts, with so many digits that they differ where the numbers do; at least `digits`."""
    for count in range(digits, 17):
        texts = f"{value:.{count}g}", f"{limit:.{count}g}"
        if texts[0] != texts[1] or value == limit:
            break
    return texts
