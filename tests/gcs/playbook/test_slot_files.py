"""Formations from files: tables, QGroundControl's plans and KML maps, whatever is in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs.playbook.loader import PlaybookError, load_playbook
from gcs.playbook.schema import Playbook
from gcs.playbook.slot_files.slots import Problem, SlotFileError
from gcs.playbook.slot_files.slots import number as as_number
from planner.formations import Slots
from planner.frames import FormationFrame, GeodeticPosition, SiteFrame

PLAYBOOK = """\
playbook: 1
name: three
site: {latitude_deg: 47.3977, longitude_deg: 8.5456, altitude_m: 488, axis_azimuth_deg: 30}
formation: {kind: KIND, file: slots.KIND}
transmitters:
  L0: {at: [0, 0]}
  L1: {at: [60, 0]}
receivers:
  U1: {start: {radius_m: 40, angle_deg: 70}}
  U2: {start: [-70, 20]}
  U3: {start: [15, -80]}
"""
ORIGIN = GeodeticPosition(47.3977, 8.5456, 488.0)
FRAME = FormationFrame(30.0 * 3.141592653589793 / 180.0)
SLOTS = {"A": 10 + 40j, "B": -30 + 50j, "C": 5.5 - 40j}

SITE = SiteFrame(ORIGIN)
DEGREES = {
    name: (at.latitude_deg, at.longitude_deg)
    for name, at in ((name, SITE.to_geodetic(FRAME.to_site(point))) for name, point in SLOTS.items())
}

NS = 'xmlns="http://www.opengis.net/kml/2.2"'


def kml(content: str, before: str = "") -> str:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{before}<kml {NS}><Document>\n{content}\n</Document></kml>\n'


def coordinates(close: bool = False, altitude: str = ",0") -> str:
    places = [f"{longitude!r},{latitude!r}{altitude}" for latitude, longitude in DEGREES.values()]
    return "\n  ".join(places + places[: int(close)])


def placemarks() -> str:
    return "\n".join(
        f"<Placemark><name>{name}</name><LookAt><latitude>1</latitude></LookAt>"
        f"<Point><coordinates>{longitude!r},{latitude!r}</coordinates></Point></Placemark>"
        for name, (latitude, longitude) in DEGREES.items()
    )


def polygon(hole: str = "") -> str:
    ring = f"<LinearRing><coordinates>\n  {coordinates(close=True)}\n</coordinates></LinearRing>"
    return f"<Placemark><Polygon><outerBoundaryIs>{ring}</outerBoundaryIs>{hole}</Polygon></Placemark>"


def waypoint(latitude: Any, longitude: Any, command: int = 16, frame: int = 3) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": frame,
        "params": [0, 0, 0, None, latitude, longitude, 20],
    }


def plan(items: list[Any], fences: tuple[Any, ...] = ()) -> str:
    fence = {"circles": [], "polygons": list(fences), "version": 2}
    return json.dumps({"fileType": "Plan", "geoFence": fence, "mission": {"items": items, "version": 2}, "version": 1})


WAYPOINTS = [waypoint(*place) for place in DEGREES.values()]
CORNERS = [list(place) for place in DEGREES.values()]


class Folder:
    """A playbook's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def load(self, kind: str, content: str | bytes, **changes: str) -> Playbook:
        data = content if isinstance(content, bytes) else content.encode()
        (self.path / f"slots.{kind}").write_bytes(data)
        text = PLAYBOOK.replace("KIND", kind)
        for found, instead in changes.items():
            assert found in text
            text = text.replace(found, instead)
        (self.path / "test.yaml").write_text(text)
        return load_playbook(self.path / "test.yaml")

    def problems(self, kind: str, content: str | bytes, **changes: str) -> list[str]:
        with pytest.raises(PlaybookError) as caught:
            self.load(kind, content, **changes)
        return [str(problem).removeprefix(f"{self.path}/") for problem in caught.value.problems]


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


def near(slots: Slots, names: str = "ABC") -> None:
    assert list(slots) == list(names) if len(names) == 3 else list(slots) == names.split()
    for found, expected in zip(slots.values(), SLOTS.values(), strict=True):
        assert abs(found - expected) < 0.001


GLOBE = "".join(f"{name},{latitude!r},{longitude!r}\n" for name, (latitude, longitude) in DEGREES.items())


@pytest.mark.parametrize(
    ("content", "names"),
    [
        ("name,x,y\nA,10,40\nB,-30,50\nC,5.5,-4e1\n", "ABC"),
        ("x,y\n10,40\n-30,50\n5.5,-40\n", "O1 O2 O3"),
        ("\ufeff Y ; X ; Name \r\n40;10;A\r\n\r\n 50 ; -30 ;B\r\n-40;5.5;C", "ABC"),
        ('name,x,y\n"A",10,40\n"B",-30,50\n,5.5,-40\n', "A B O3"),
        ("name,lat,lon\n" + GLOBE, "ABC"),
    ],
)
def test_a_table(folder: Folder, content: str, names: str) -> None:
    near(folder.load("csv", content).problem().slots, names)


@pytest.mark.parametrize(
    "content",
    [
        plan([waypoint(1, 2, command=22), *WAYPOINTS, waypoint(0, 0, command=20)]),
        plan(WAYPOINTS, ({"polygon": [[1, 2], [3, 4], [5, 6]]},)),
        plan([], ({"polygon": CORNERS, "inclusion": True, "version": 1},)),
        plan([{"type": "ComplexItem", "complexItemType": "survey", "polygon": CORNERS}]),
    ],
)
def test_a_plan_of_a_ground_station(folder: Folder, content: str) -> None:
    near(folder.load("plan", content).problem().slots, "O1 O2 O3")


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (kml(placemarks()), "ABC"),
        (kml(placemarks() + polygon()), "ABC"),
        (kml(f"<LineString><coordinates>{coordinates()}</coordinates></LineString>"), "O1 O2 O3"),
        (kml(polygon()), "O1 O2 O3"),
        (kml(polygon("<innerBoundaryIs><LinearRing><coordinates>1,2 3,4</coordinates></LinearRing></innerBoundaryIs>")),
         "O1 O2 O3"),
        (f'<k:kml xmlns:k="http://www.opengis.net/kml/2.2">{polygon().replace("<", "<k:").replace("<k:/", "</k:")}'
         "</k:kml>", "O1 O2 O3"),
    ],
)  # fmt: skip
def test_a_map(folder: Folder, content: str, names: str) -> None:
    near(folder.load("kml", content).problem().slots, names)


def test_a_formation_from_a_file_is_turned_and_scaled_like_any_other(folder: Folder) -> None:
    changes = {"file: slots.csv": "file: slots.csv, scale: 2, rotation_deg: 90, mirrored: true"}
    slots = folder.load("csv", "name,x,y\nA,10,40\nB,-30,50\nC,5.5,-40\n", **changes).problem().slots
    for name, point in SLOTS.items():
        assert slots[name] == pytest.approx(2j * point.conjugate())


def test_the_resolved_playbook_needs_no_file(folder: Folder) -> None:
    changes = {"file: slots.csv": "file: slots.csv, scale: 2"}
    playbook = folder.load("csv", "name,x,y\nA,10,40\nB,-30,50\nC,5.5,-40\n", **changes)
    resolved = playbook.model_dump(mode="json")
    assert resolved["formation"]["kind"] == "custom"
    again = Playbook.model_validate(json.loads(json.dumps(resolved)))
    assert again.problem().slots == playbook.problem().slots
    assert playbook.model_copy().problem().slots == playbook.problem().slots


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", ["slots.csv:1:1: the first line is empty: columns are x, y"]),
        ("A,10,40\n", ["slots.csv:1:1: the first line is a, 10, 40: columns are x, y"]),
        ("name,x,lat\n", ["slots.csv:1:1: the first line is name, x, lat"]),
        ("name,x,y,z\nA,1,2,3\n", ["slots.csv:1:1: the first line is name, x, y, z"]),
        ("x,y,x\n1,2,3\n", ["slots.csv:1:1: the first line is x, y, x"]),
        ("x,y\n", ["slots.csv:1:1: holds no slots"]),
        (
            "name,x,y\nA,ten,40\n\nB,nan,1\nC,1\nD,1_0,2\nE,١,2\n",
            [
                "slots.csv:2:1: 'ten' is no number",
                "slots.csv:4:1: 'nan' is no number",
                "slots.csv:5:1: 2 values in 3 columns",
                "slots.csv:6:1: '1_0' is no number",
                "slots.csv:7:1: '١' is no number",
            ],
        ),
        (
            "name,x,y\nA,1,2\nA,3,4\na/b,5,6\n",
            ["slots.csv:3:1: slot A: there is another of this name", "slots.csv:4:1: slot a/b: a name is of letters"],
        ),
        ("name,x,y\nA,1,2\nB,3e5,4\nC,1,9\n", ["slots.csv:3:1: slot B: it lies 300 km from L0"]),
        ("lat,lon\n91,8\n47,181\n", ["slots.csv:2:1: there is no latitude 91°", "slots.csv:3:1: there is no lat"]),
        ("lat,lon\n-35.36,149.16\n", ["slots.csv:2:1: slot O1: it lies"]),
        ('x,y\n"1,2\n', ["slots.csv:2:1: is no CSV"]),
        (b"x,y\n\xff\xfe,1\n", ["slots.csv:1:1: is no text"]),
        (b"x,y\n" + b"1,2\n" * 1_100_000, ["slots.csv:1:1: is too large"]),
        ("x,y\n" + "".join(f"{k},1\n" for k in range(10_002)), ["slots.csv:10002:1: holds more than 10000 slots"]),
    ],
)  # fmt: skip
def test_everything_wrong_in_a_table_with_its_line(folder: Folder, content: str | bytes, expected: list[str]) -> None:
    problems = folder.problems("csv", content)
    assert len(problems) == len(expected)
    for problem, start in zip(problems, expected, strict=True):
        assert problem.startswith(start)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ('{"fileType": "Plan",\n "mission": }', "slots.plan:2:1: is no plan"),
        ("[" * 100_000, "slots.plan:1:1: is no plan: maximum recursion depth"),
        ("[]", "it has no fileType"),
        ('{"fileType": "Fence"}', "it has no fileType"),
        ('{"fileType": "Plan"}', "is not formed like a plan"),
        ('{"fileType": "Plan", "mission": {"items": [1]}}', "is not formed like a plan"),
        ('{"fileType": "Plan", "mission": {"items": 1}}', "is not formed like a plan"),
        (plan([]), "holds no waypoints and 0 polygons"),
        (plan([], ({"polygon": CORNERS}, {"polygon": CORNERS})), "holds no waypoints and 2 polygons"),
        (plan([*WAYPOINTS, waypoint(1, 2, frame=1)]), "item 4 is in frame 1"),
        (plan([waypoint(None, 2)]), "item 1: None is no number"),
        (plan([waypoint(float("nan"), 2)]), "item 1: nan is no number"),
        (plan([waypoint(47.4, longitude=True)]), "item 1: True is no number"),
        (plan([waypoint(10**400, 8.5)]), "0000 is no number"),
        (plan([]).replace("2", "9" * 5_000), "is no plan: Exceeds the limit"),
        (plan([waypoint(0, 0)]), "slot O1: it lies"),
        (plan([], ({"polygon": [[1], [2]]},)), "is not formed like a plan"),
    ],
)
def test_what_is_wrong_with_a_plan(folder: Folder, content: str, expected: str) -> None:
    (problem,) = folder.problems("plan", content)
    assert problem.startswith("slots.plan:")
    assert expected in problem


BOMB = "".join(f'<!ENTITY l{k} "{10 * f"&l{k - 1};"}">' for k in range(1, 10))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", "slots.kml:1:1: is no KML: no element found"),
        ("<kml>\n<Document>\n</kml>", "slots.kml:3:1: is no KML: mismatched tag"),
        ("PK\x03\x04", "is no KML"),
        (kml(""), "holds no points and 0 lines and polygons"),
        (kml(polygon() + polygon()), "holds no points and 2 lines and polygons"),
        (kml("<Placemark><Point><coordinates>\n8.5,47.4\n8.5\n</coordinates></Point></Placemark>"),
         "slots.kml:5:1: '8.5' is not longitude,latitude"),
        (kml("<Placemark><Point><coordinates>8.5,north</coordinates></Point></Placemark>"), "'north' is no number"),
        (kml("<Placemark><Point><coordinates>8.5,147.4</coordinates></Point></Placemark>"), "no latitude 147.4°"),
        (kml(placemarks().replace(">A<", ">slot A<")), "slot slot A: a name is of letters"),
        (kml("&l9;", f'<!DOCTYPE kml [<!ENTITY l0 "ha">{BOMB}]>\n'), "slots.kml:2:1: has a document type (kml)"),
        (kml("&x;", '<!DOCTYPE kml [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n'), "has a document type (kml)"),
        (kml("", '<!DOCTYPE kml SYSTEM "http://127.0.0.1:9/kml.dtd">\n'), "has a document type (kml)"),
        (kml("&undefined;"), "is no KML: undefined entity"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_map_and_what_is_dangerous_in_one(folder: Folder, content: str, expected: str) -> None:
    (problem,) = folder.problems("kml", content)
    assert problem.startswith("slots.kml:")
    assert expected in problem


def test_a_file_that_is_not_there_is_said_where_the_playbook_names_it(folder: Folder) -> None:
    (problem,) = folder.problems("csv", "x,y\n1,2\n", **{"file: slots.csv": "file: other.csv"})
    assert problem.startswith("test.yaml:4:1: formation: ")
    assert "other.csv cannot be read: No such file" in problem


def test_a_site_that_is_wrong_is_said_besides(folder: Folder) -> None:
    problems = folder.problems("csv", "name,lat,lon\n" + GLOBE, **{"latitude_deg: 47.3977": "latitude_deg: 470"})
    assert any(problem.startswith("test.yaml:3:8: site.latitude_deg") for problem in problems)
    assert any("the playbook's site, which is not right" in problem for problem in problems)


def test_a_playbook_without_a_file_of_its_own_has_none_for_its_slots() -> None:
    with pytest.raises(ValueError, match="read with the playbook's own file"):
        Playbook.model_validate({"playbook": 1, "name": "x", "formation": {"kind": "csv", "file": "slots.csv"}})


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_never_cause_a_traceback(folder: Folder, data: st.DataObject) -> None:
    kind, whole = data.draw(
        st.sampled_from(
            [("csv", "name,lat,lon\n" + GLOBE), ("plan", plan(WAYPOINTS)), ("kml", kml(placemarks() + polygon()))]
        )
    )
    start = data.draw(st.integers(0, len(whole)))
    noise = data.draw(st.text(st.characters(codec="utf-8"), max_size=6))
    damaged = whole[:start] + noise + whole[start + data.draw(st.integers(0, 8)) :]
    found: list[str] = []
    try:
        folder.load(kind, damaged)
    except PlaybookError as error:
        found = [str(problem) for problem in error.problems]
    assert all(problem for problem in found)


@given(st.text(max_size=8) | st.floats() | st.none() | st.booleans() | st.integers())
def test_a_number_is_finite_or_refused(value: Any) -> None:
    try:
        read = as_number(value)
    except ValueError:
        return
    assert read == float(value)


def test_an_error_names_file_and_line() -> None:
    assert str(SlotFileError(Path("a.csv"), [Problem(3, "x"), Problem(4, "y")])) == "a.csv:3: x\na.csv:4: y"
