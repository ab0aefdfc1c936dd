"""What axe-core finds on a page, wide and narrow, light and dark."""

from axe_playwright_python.sync_playwright import Axe

SIZES = ({"width": 1280, "height": 900}, {"width": 390, "height": 844})
CONTRAST = {"runOnly": {"type": "rule", "values": ["color-contrast"]}, "resultTypes": ["violations"]}
EVERYTHING = {"resultTypes": ["violations"]}


def found(tab, options=EVERYTHING):
    """Return the violations that are serious or critical: rule and first place of each."""
    response = Axe().run(tab, options=options).response
    grave = [one for one in response["violations"] if one["impact"] in ("serious", "critical")]
    return [(one["id"], [node["html"][:200] for node in one["nodes"]]) for one in grave]


def grave(tab):
    """Return what is wrong in each size and each scheme, by both; of the second scheme only colours differ."""
    wrong = {}
    for size in SIZES:
        tab.set_viewport_size(size)
        for scheme, options in (("light", EVERYTHING), ("dark", CONTRAST)):
            tab.emulate_media(color_scheme=scheme)
            wrong[size["width"], scheme] = found(tab, options)
            beyond = tab.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            if beyond > 0:
                wrong[size["width"], scheme].append(("wider than the window", beyond))
    return {where: what for where, what in wrong.items() if what}
