"""A CPACS file of a wing with a flap, whose parts can be replaced."""

X = [1.0, 0.5, 0.0, 0.5, 1.0]
# A profile of four straight sides, 2 % thick at the trailing edge.
Z = [-0.01, -0.06, 0.0, 0.06, 0.01]


def transformation(scaling=(1, 1, 1), rotation=(0, 0, 0), translation=(0, 0, 0), kind="absLocal"):
    parts = {"scaling": scaling, "rotation": rotation, "translation": translation}
    text = "".join(
        f"<{name}{f' refType={chr(34)}{kind}{chr(34)}' if name == 'translation' else ''}>"
        + "".join(f"<{axis}>{value}</{axis}>" for axis, value in zip("xyz", values, strict=True))
        + f"</{name}>"
        for name, values in parts.items()
    )
    return f"<transformation>{text}</transformation>"


def section(number, element="", place=""):
    return f"""<section uID="s{number}">{place or transformation()}<elements><element uID="e{number}">
      <airfoilUID>foil</airfoilUID>{element or transformation()}</element></elements></section>"""


def positioning(number, length, sweep=0.0, dihedral=0.0):
    before = f"<fromSectionUID>s{number - 1}</fromSectionUID>" if number > 1 else ""
    return f"""<positioning><length>{length}</length><sweepAngle>{sweep}</sweepAngle>
      <dihedralAngle>{dihedral}</dihedralAngle>{before}<toSectionUID>s{number}</toSectionUID></positioning>"""


def border(name, eta, reference="cs"):
    inner = f"<eta>{eta}</eta><referenceUID>{reference}</referenceUID>" if reference else f"{eta}"
    return f"<{name}Border><etaLE>{inner}</etaLE></{name}Border>"


STEPS = """<step><controlParameter>-1</controlParameter><hingeLineRotation>-20</hingeLineRotation></step>
  <step><controlParameter>0</controlParameter><hingeLineRotation>0</hingeLineRotation></step>
  <step><controlParameter>1</controlParameter><hingeLineRotation>30</hingeLineRotation></step>"""
WING = {
    "wing": transformation(kind="absGlobal"),
    "parent": "",
    "sections": section(1) + section(2, transformation(scaling=(0.5, 1, 0.5))),
    "positionings": positioning(1, 0.0) + positioning(2, 2.0),
    "segments": "<segment><fromElementUID>e1</fromElementUID><toElementUID>e2</toElementUID></segment>",
    "last": "e2",
    "borders": border("inner", 0.25) + border("outer", 0.75),
    "inner": "<hingeXsi>0.5</hingeXsi><hingeRelHeight>0.5</hingeRelHeight>",
    "outer": "<hingeXsi>0.75</hingeXsi><hingeRelHeight>1.0</hingeRelHeight>",
    "steps": STEPS,
    "profile": f"<pointList><x>{';'.join(map(str, X))}</x><y>0;0;0;0;0</y><z>{';'.join(map(str, Z))};</z></pointList>",
}


def written(folder, **changes):
    """Write a file with a wing and its flap."""
    part = WING | changes
    path = folder / "aircraft.xml"
    path.write_text(f"""<?xml version="1.0" encoding="utf-8"?>
<cpacs xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"><vehicles>
 <aircraft><model uID="m"><fuselages><fuselage uID="body">{transformation(translation=(1, 0, 0))}</fuselage></fuselages>
  <wings><wing uID="wing">{part["parent"]}{part["wing"]}<sections>{part["sections"]}</sections>
   <positionings>{part["positionings"]}</positionings><segments>{part["segments"]}</segments>
   <componentSegments><componentSegment uID="cs"><fromElementUID>e1</fromElementUID>
    <toElementUID>{part["last"]}</toElementUID><controlSurfaces><trailingEdgeDevices>
     <trailingEdgeDevice uID="flap"><parentUID>cs</parentUID><outerShape>{part["borders"]}</outerShape>
      <path><innerHingePoint>{part["inner"]}</innerHingePoint><outerHingePoint>{part["outer"]}</outerHingePoint>
       <steps>{part["steps"]}</steps></path></trailingEdgeDevice>
    </trailingEdgeDevices></controlSurfaces></componentSegment></componentSegments></wing></wings></model></aircraft>
 <profiles><wingAirfoils><wingAirfoil uID="foil">{part["profile"]}</wingAirfoil></wingAirfoils></profiles>
</vehicles></cpacs>""")
    return path
