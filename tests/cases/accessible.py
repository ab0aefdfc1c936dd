"""What axe-core finds on a page, wide and narrow, light and dark."""

from axe_playwright_python.sync_playwright import Axe

WIDE, NARROW = {"width": 1280, "height": 900}, {"width": 390, "height": 844}


def rules(*names):
    """Return options that try some rules, all without a name."""
    return {"resultTypes": ["violations"], **({"runOnly": {"type": "rule", "values": list(names)}} if names else {})}


# Sizes and schemes, and the rules that may hold there and not in those before: to try all takes four times as long.
TRIED = (
    (WIDE, "light", rules()),
    (WIDE, "dark", rules("color-contrast")),
    (NARROW, "dark", rules("color-contrast", "scrollable-region-focusable")),
    (NARROW, "light", rules("scrollable-region-focusable", "nested-interactive")),
)


def found(tab, options):
    """Return the violations that are serious or critical: rule and first place of each."""
    response = Axe().run(tab, options=options).response
    grave = [one for one in response["violations"] if one["impact"] in ("serious", "critical")]
    return [(one["id"], [node["html"][:200] for node in one["nodes"]]) for one in grave]


def grave(tab):
    """Return what is wrong in each size and each scheme."""
    wrong = {}
    for size, scheme, options in TRIED:
        tab.set_viewport_size(size)
        tab.emulate_media(color_scheme=scheme)
        wrong[size["width"], scheme] = found(tab, options)
        beyond = tab.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        if beyond > 0:
            wrong[size["width"], scheme].append(("wider than the window", beyond))
    return {where: what for where, what in wrong.items() if what}
