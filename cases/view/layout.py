"""The page: what stands where. Texts of a run reach it as values of the state, never as part of a template."""

from importlib.resources import files
from typing import Any

from trame.ui.vuetify3 import VAppLayout
from trame.widgets import client, html, vtk, vuetify3

from sdm_deflect.cases.view.labels import COLOURS

STYLE = "".join(
    files(f"sdm_deflect.cases.{package}").joinpath(name).read_text(encoding="utf-8")
    for package, name in (("report", "palette.css"), ("view", "style.css"))
)
NAMES = """
const name = () => document.querySelectorAll("[data-name]").forEach((one) => {
  const target = one.querySelector("[role=slider], input[type=text]");
  if (!target || target.getAttribute("aria-label") === one.dataset.name) return;
  target.removeAttribute("aria-labelledby");
  target.setAttribute("aria-label", one.dataset.name);
});
new MutationObserver(name).observe(document.body, { subtree: true, childList: true });
name();
"""
"""Gives inputs the names that the library of the page does not hand on to them."""
SCHEME = """
const scheme = matchMedia("(prefers-color-scheme: dark)");
const tell = () => trame.state.set("dark", scheme.matches);
scheme.addEventListener("change", tell);
tell();
"""
"""Tells whether the browser prefers dark colours: what the library and the scene draw knows nothing of style sheets."""
TURNS = (
    ("left", "\N{LEFTWARDS ARROW}", -1, 0), ("right", "\N{RIGHTWARDS ARROW}", 1, 0),
    ("up", "\N{UPWARDS ARROW}", 0, 1), ("down", "\N{DOWNWARDS ARROW}", 0, -1),
)  # fmt: skip
"""Buttons that turn the picture: name, sign, and by how many steps about the vertical and upwards."""
HEADING = "font:600 11px sans-serif;letter-spacing:.04em;color:var(--soft);margin:9px 0 2px"
SMALL = "font:12px/1.45 sans-serif"
NUMBER = "text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums"
BOX = "font:13px/1.4 sans-serif;margin-top:6px;padding:5px 10px;border-radius:3px;border-left:5px solid "
NOTES = {kind: f"var(--{kind});background:var(--{kind}-ground)" for kind in ("success", "warning", "error")}
"""Border and background of a message; its text says the same in words."""
NAMED = [("data_name", "data-name")]
TYPED = "[$event.target.value]"
PLAIN = "text-transform:none;letter-spacing:normal"
KEY = "position:absolute;right:12px;bottom:10px;max-width:244px;background:var(--veil);padding:6px 10px;" + SMALL


def lay_out(server: Any, window: Any, actions: Any) -> Any:
    """Lay the page out and return the view; `actions` are what its buttons call."""
    with VAppLayout(server, theme=(_either("dark", "light"),)), html.Div(id="page"):
        client.Style(STYLE)
        client.Script(NAMES)
        client.Script(SCHEME)
        with html.Main(id="panel"), html.Div(style="padding:10px 18px"):
            html.H1("{{ run_title }}", style="font:600 17px/1.3 sans-serif", id="title")
            html.Div("{{ run_facts }}", style=SMALL + ";margin-top:4px")
            _angle(actions.accept)
            _numbers()
            _section(actions.face, actions.worst)
            _shown()
        with html.Div(id="stage"):
            view = vtk.VtkLocalView(window, ref="view", id="view", after_scene_loaded=actions.loaded)
            _key()
            with html.Div(style="position:absolute;left:12px;top:10px;display:flex;gap:4px", id="turns"):
                _turn("first view", actions.fit, "fit")
                for name, sign, about, upwards in TURNS:
                    _turn(sign, (actions.turn, f"[{about}, {upwards}]"), f"turn-{name}", f"turn {name}")
    return view


def _either(dark: str, light: str) -> str:
    """Return the expression of one of two names, as the browser prefers dark colours or not."""
    return f"dark ? '{dark}' : '{light}'"


def _turn(text: str, click: Any, key: str, label: str | None = None) -> None:
    """A button on the picture."""
    named = {"aria_label": label} if label else {}
    style = "background:var(--ground);min-width:30px;" + PLAIN
    vuetify3.VBtn(text, click=click, size="small", variant="outlined", id=key, style=style, **named)


def _angle(accept: Any) -> None:
    """The slider, the band of verified angles below it, the text field and the verdict."""
    html.Div("DEFLECTION", style=HEADING)
    with html.Div(style="display:flex;gap:12px;align-items:center"):
        with html.Div(style="flex:1;min-width:0"):
            _slider("angle", "deflection angle", _either("blue-lighten-2", "blue-darken-3"))
            html.Div(style=("band",), title=("band_text",))
        with html.Div(style="width:104px", data_name="deflection angle, typed", __properties=NAMED):
            vuetify3.VTextField(
                v_model=("angle_text",),
                suffix=("unit",),
                density="compact",
                variant="outlined",
                hide_details=True,
                id="angle-text",
                error=("!!refusal",),
                blur=(accept, TYPED),
                keydown_enter=(accept, TYPED),
                __events=[("keydown_enter", "keydown.enter")],
            )
    html.Div("{{ band_text }}", style=SMALL + ";margin-top:2px")
    refused = BOX + NOTES["error"]
    html.Div("\N{MULTIPLICATION X} {{ refusal }}", v_if=("refusal",), id="refusal", style=refused, role="alert")
    html.Div("{{ status }}", id="status", style=("status_style",), aria_live="polite")
    html.Div("{{ repair }}", id="repair", style=SMALL + ";margin-top:4px", aria_live="polite")


def _slider(name: str, label: str, colour: str) -> None:
    """A slider of one value of the state, whose ends and step are in the state as well."""
    with html.Div(data_name=label, __properties=NAMED):
        vuetify3.VSlider(
            v_model=(name,),
            min=(f"{name}_low",),
            max=(f"{name}_high",),
            step=(f"{name}_step",),
            color=(colour,),
            density="compact",
            hide_details=True,
            id=name,
        )


def _numbers() -> None:
    """The table of numbers and the histogram."""
    with html.Table(style=SMALL + ";width:100%;border-collapse:collapse;margin-top:6px"):
        with html.Tr(v_for="row in facts", key="row.id", style="border-bottom:1px solid var(--line)"):
            html.Td("{{ row.name }}", style="padding:1px 0;white-space:pre")
            html.Td("{{ row.value }}", id=("row.id",), style=NUMBER)
        with html.Tr():
            html.Td("last update took", style="padding:1px 0")
            html.Td("{{ elapsed }} ms", id="elapsed", style=NUMBER)
    html.Div("CELLS AT THE BOX BY QUALITY (line: undeflected)", style=HEADING)
    html.Div(v_html=("histogram",), id="histogram")


def _section(face: Any, worst: Any) -> None:
    """Where the section is."""
    html.Div("SECTION", style=HEADING)
    with html.Div(style="display:flex;gap:10px;align-items:center"):
        with vuetify3.VBtnToggle(
            v_model=("axis",), mandatory=True, density="compact", variant="outlined", divided=True, id="axis"
        ):
            for axis in ("x", "y", "z"):
                vuetify3.VBtn(axis, value=axis, size="small", style="text-transform:none", id=f"axis-{axis}")
        with html.Div(style="flex:1;min-width:0"):
            _slider("position", "position of the section", _either("grey-lighten-1", "grey-darken-2"))
    with html.Div(style="display:flex;gap:6px;align-items:center;" + SMALL):
        place = "{{ axis }} = {{ (length_factor * position).toFixed(decimals) }}{{ length_unit }}"
        html.Div(place, style="flex:1;white-space:nowrap")
        for label, click, key in (("to the worst cell", worst, "worst-cell"), ("face it", face, "face")):
            vuetify3.VBtn(label, click=click, size="small", variant="outlined", id=key, style=PLAIN)


def _shown() -> None:
    """What else is shown."""
    html.Div("COLOURS", style=HEADING)
    with vuetify3.VBtnToggle(
        v_model=("colour",), mandatory=True, density="compact", variant="outlined", divided=True, id="colour"
    ):
        for name, text in COLOURS.items():
            vuetify3.VBtn(text, value=name, size="small", style=PLAIN, id=f"colour-{name}")
    html.Div("SHOW", style=HEADING)
    with html.Div(style="display:grid;grid-template-columns:1fr 1fr"):
        for name, label in (
            ("sectioned", "section"),
            ("cut", "cut the walls open"),
            ("box", "box"),
            ("centres", "centres"),
            ("outline", "undeflected outline"),
        ):
            vuetify3.VCheckbox(
                v_model=(f"show_{name}",),
                label=label,
                density="compact",
                hide_details=True,
                id=f"show-{name}",
                style="--v-input-control-height:28px",
            )


def _key() -> None:
    """The key to the colours."""
    with html.Div(style=KEY, id="key"):
        html.Div("{{ key_title }}", id="key-title")
        html.Div(style=("key_bar",), id="key-bar")
        with html.Div(style="display:flex;justify-content:space-between"):
            html.Span("{{ end }}", v_for="(end, i) in key_ends", key="i")
        with html.Div():
            html.Span(id="key-inverted")
            html.Span(" inverted cells")
