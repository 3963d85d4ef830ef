"""Landmarks in the files of those who place them: read, written, and found beside meshes."""

import codecs
import copy
import json
import os
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from skfmap import Landmarks, Mesh
from skfmap.datasets import load_collection, make_sphere
from skfmap.datasets._landmark_files import landmarks_on
from skfmap.exceptions import CorrespondenceError, RepairWarning, SkippedShapeWarning
from skfmap.io import read_landmarks, write_landmarks, write_mesh
from skfmap.persistence import TRUSTED_TYPES

HUNTED = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=50
)
DATA = Path(os.environ.get("SKFMAP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
NAN = [np.nan] * 3
WRITTEN = (".fcsv", ".mrk.json", ".pp", ".tps", ".pts", ".csv")


@pytest.fixture
def predicted():
    points = [[1, 2, 3], NAN, [4, 5, 6]]
    return Landmarks(
        points,
        ["a", "b", "c"],
        name="cat",
        expected_error=[0.1, np.nan, 0.2],
        radius=[1 / 3, np.nan, 2 / 3],
        coverage=0.9,
    )


def _read(tmp_path, suffix, text, **options):
    path = tmp_path / f"cat_Landmarks{suffix}"
    if isinstance(text, bytes):
        path.write_bytes(text)
    else:
        path.write_text(text, encoding="utf-8")
    return read_landmarks(path, **options)


def _assert_are(landmarks, expected):
    assert landmarks.names == tuple(expected)
    assert_array_equal(landmarks.points, np.array(list(expected.values()), dtype=float))


# Each format, from the text


FCSV = '''# Markups fiducial file version = 4.13
# CoordinateSystem = {system}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
vtkMRMLMarkupsFiducialNode_0,-1.5,2,3e-1,0,0,0,1,1,1,1,"left, ""upper""",a note,
vtkMRMLMarkupsFiducialNode_1,4,5,6,0,0,0,1,1,1,1,chin,"one, two",vtkMRMLScalarVolumeNode1
'''
POINTS = {'left, "upper"': [-1.5, 2, 0.3], "chin": [4, 5, 6]}


@pytest.mark.parametrize("system", ["LPS", "RAS", "0", "1"])
def test_fcsv_is_read_as_written_and_turned_if_asked(tmp_path, system):
    landmarks = _read(tmp_path, ".fcsv", FCSV.format(system=system))
    _assert_are(landmarks, POINTS)
    assert landmarks.name == "cat"
    is_lps = system in {"LPS", "1"}
    for asked in ("LPS", "RAS"):
        turned = _read(tmp_path, ".fcsv", FCSV.format(system=system), system=asked)
        signs = [1, 1, 1] if is_lps == (asked == "LPS") else [-1, -1, 1]
        assert_array_equal(turned.points, landmarks.points * signs)


def test_fcsv_of_slicer_5_says_which_points_were_placed(tmp_path):
    text = FCSV.format(system="LPS") + (
        "3,0,0,0,0,0,0,1,1,1,0,undefined,,,0,0\n"
        "4,7,8,9,0,0,0,1,1,1,0,defined,,,2,0\n"
        "5,7,8,9,0,0,0,1,1,1,0,preview,,,1,0\n"
        "6,nan,nan,nan,0,0,0,1,1,1,0,nowhere,,\n"
    )
    more = {"undefined": NAN, "defined": [7, 8, 9], "preview": NAN, "nowhere": NAN}
    _assert_are(_read(tmp_path, ".fcsv", text), {**POINTS, **more})


def test_a_comma_outside_quotes_makes_no_point_of_fcsv_missing(tmp_path):
    ends = ("left, upper,,vtkMRMLScalarVolumeNode1", "b,one,two,three,node,2,0", "c,,,")
    rows = "".join(f"{i},{i},0,0,0,0,0,1,1,1,0,{end}\n" for i, end in enumerate(ends))
    _assert_are(_read(tmp_path, ".fcsv", rows), {"left": [0, 0, 0], "b": [1, 0, 0], "c": [2, 0, 0]})


def test_fcsv_of_slicer_3_has_other_columns(tmp_path):
    text = "# Fiducial List file x.fcsv\n# columns = label,x,y,z,sel,vis\nnose,1,2,3,1,1\n"
    _assert_are(_read(tmp_path, ".fcsv", text), {"nose": [1, 2, 3]})
    with pytest.raises(CorrespondenceError, match=r"not say whether it is in LPS or RAS"):
        _read(tmp_path, ".fcsv", text, system="LPS")


def test_points_of_slicer_without_a_label_are_numbered(tmp_path):
    rows = "".join(f"{i},{i},0,0,0,0,0,1,1,1,0,,,\n" for i in range(3))
    _assert_are(_read(tmp_path, ".fcsv", rows), {"1": [0, 0, 0], "2": [1, 0, 0], "3": [2, 0, 0]})


def _markup(points, **changes):
    points = [
        {
            "id": str(i),
            "label": label,
            "position": list(map(float, at)),
            "orientation": [-1, 0, 0, 0, -1, 0, 0, 0, 1],
            "positionStatus": status,
        }
        for i, (label, at, status) in enumerate(points)
    ]
    return {"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points, **changes}


def _mrk(points, **changes):
    return json.dumps({"markups": [_markup(points, **changes)]})


def test_mrk_json_keeps_the_names_of_what_was_not_placed(tmp_path):
    points = [
        ("nose", [1, 2, 3], "defined"),
        ("", [4, 5, 6], "defined"),
        ("c", [0, 0, 0], "undefined"),
        ("d", [0, 0, 0], "preview"),
        ("e", NAN, "defined"),
    ]
    expected = {"nose": [1, 2, 3], "2": [4, 5, 6], "c": NAN, "d": NAN, "e": NAN}
    _assert_are(_read(tmp_path, ".mrk.json", _mrk(points)), expected)
    turned = _read(tmp_path, ".mrk.json", _mrk(points, coordinateSystem="RAS"), system="LPS")
    assert_array_equal(turned.point("nose"), [-1, -2, 3])


def test_mrk_json_with_a_curve_beside_the_list_gives_the_list(tmp_path):
    curve = _markup([("a", [9, 9, 9], "defined")], type="Curve")
    markups = {"markups": [curve, _markup([("b", [1, 2, 3], "defined")])]}
    _assert_are(_read(tmp_path, ".mrk.json", json.dumps(markups)), {"b": [1, 2, 3]})
    message = r"contains Curve \(1 points\), Line \(1 points\)"
    with pytest.raises(CorrespondenceError, match=message):
        _read(tmp_path, ".mrk.json", json.dumps({"markups": [curve, {**curve, "type": "Line"}]}))


PP = """<!DOCTYPE PickedPoints>
<PickedPoints>
 <DocumentData>
  <DateTime time="16:00:26" date="2009-02-12"/>
  <DataFileName name="cat.ply"/>
 </DocumentData>
 <point x="1.5" y="-2" z="3e-05" active="1" name="a &amp; b"/>
 <point y="5" z="6" x="4" name="c" active="0"/>
</PickedPoints>
"""


def test_picked_points_of_meshlab(tmp_path):
    _assert_are(_read(tmp_path, ".pp", PP), {"a & b": [1.5, -2, 3e-5], "c": NAN})


TPS = """LM3=2
1 2 3
-4.5 5 NA
"""


def test_tps_multiplies_by_its_scale(tmp_path):
    text = "LM3=3\n1 2 3\n4 5 6\nNA NA NA\nIMAGE=scan.png\nID=Felix\nSCALE=0.5\n"
    landmarks = _read(tmp_path, ".tps", text)
    _assert_are(landmarks, {"1": [0.5, 1, 1.5], "2": [2, 2.5, 3], "3": NAN})
    assert landmarks.name == "Felix"


def test_one_of_several_specimens_of_a_tps_file_is_chosen(tmp_path):
    text = (
        "LM3=1\n1 0 0\nID=Felix\nLM3=1\n2 0 0\nIMAGE=tom.jpg\n"
        "lm3=1\n3 0 0\nCURVES3=1\nPOINTS3=2\n0 0 0\n9 9 9\nID=\n"
    )
    for specimen, x in (("Felix", 1), ("tom", 2), (0, 1), (2, 3)):
        assert _read(tmp_path, ".tps", text, specimen=specimen).points.tolist() == [[x, 0, 0]]
    with pytest.raises(CorrespondenceError, match=r"3 specimens: 'Felix', 'tom', 2\. Choose one"):
        _read(tmp_path, ".tps", text)
    with pytest.raises(CorrespondenceError, match="0 specimens called 'Garfield'"):
        _read(tmp_path, ".tps", text, specimen="Garfield")
    with pytest.raises(CorrespondenceError, match="no specimen 3; there are 3"):
        _read(tmp_path, ".tps", text, specimen=3)
    with pytest.raises(ValueError, match="selects from a tps file"):
        _read(tmp_path, ".csv", "1,2,3\n", specimen="Felix")


def test_pts_of_landmark_editor(tmp_path):
    text = "Version 1.0\n3\nS0000 1 2 3\nleft ear 4 5 6\nS0002 9999 9999 9999\n"
    _assert_are(
        _read(tmp_path, ".pts", text), {"S0000": [1, 2, 3], "left ear": [4, 5, 6], "S0002": NAN}
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name,x,y,z\na,1,2,3\nb,,,\n", {"a": [1, 2, 3], "b": NAN}),
        ("Z;Label;Y;X\n3,5;a;2;1\n", {"a": [1, 2, 3.5]}),
        ("x\ty\tz\n1,5\t2\t3\n", {"1": [1.5, 2, 3]}),
        ("# x y z\n1 2 3\n-999 -999 -999\n", {"1": [1, 2, 3], "2": NAN}),
        ("1,2,3\n\n4,5,6\n", {"1": [1, 2, 3], "2": [4, 5, 6]}),
        ("1, 2, 3\n-9999,-9999,-9999\n", {"1": [1, 2, 3], "2": NAN}),
        ("-999, 2, 3\n", {"1": [-999, 2, 3]}),
        ('"left, ear",1,2,3\n"b",NA,NaN,\n', {"left, ear": [1, 2, 3], "b": NAN}),
        ("1 2 3 nose\n4 5 6 'chin'\n", {"nose": [1, 2, 3], "'chin'": [4, 5, 6]}),
        ('"left ear" 1,5 2 3\nb 4 5 6\n', {"left ear": [1.5, 2, 3], "b": [4, 5, 6]}),
        ("1,1.5,2,3\n2,4,5,6\n", {"1": [1.5, 2, 3], "2": [4, 5, 6]}),
        ("# by hand\n#1,1,2,3\n#2,4,5,6\n", {"#1": [1, 2, 3], "#2": [4, 5, 6]}),
        ("ID,X (mm),Y (mm),Z (mm),note\r\np,1,2,3,ok\r\n", {"p": [1, 2, 3]}),
        (',"x","y","z"\n"1",1,2,3\n', {"1": [1, 2, 3]}),
        ("specimen,Point name,x,y,z\ncat,a,1,2,3\n,,,,\n", {"a": [1, 2, 3]}),
        ("nr,x,y,z\n2,1,2,3\n1,4,5,6\n", {"2": [1, 2, 3], "1": [4, 5, 6]}),
        ("1,2,3,\n,,,\n", {"1": [1, 2, 3], "2": NAN}),
        ("x,y,z\n1,2,3,\n4,5,6,\n", {"1": [1, 2, 3], "2": [4, 5, 6]}),
        ('"x" "y" "z"\n"nose" 1 2 3\n"chin" NA NA NA\n', {"nose": [1, 2, 3], "chin": NAN}),
        ("sep=;\nname;x;y;z\na;1,5;2;3\n", {"a": [1.5, 2, 3]}),
        ("Punkt;X;Y;Z\nNase;1,5;2;3\nKinn;n.a.;n.a.;n.a.\n", {"Nase": [1.5, 2, 3], "Kinn": NAN}),
        ("who;x;y;z\nme;1;2;3\nme;4;5;6\n", {"1": [1, 2, 3], "2": [4, 5, 6]}),
        ("t;x;y;z\n7;1;2;3\n8;4;5;6\n", {"1": [1, 2, 3], "2": [4, 5, 6]}),
    ],
)
def test_tables_of_many_kinds(tmp_path, text, expected):
    for suffix in (".csv", ".txt", ".tsv"):
        _assert_are(_read(tmp_path, suffix, text), expected)


def test_tables_of_slicer_name_their_system_and_what_is_defined(tmp_path):
    text = "label,r,a,s,defined,selected\nnose,1,2,3,1,1\nchin,0,0,0,0,1\n"
    _assert_are(_read(tmp_path, ".csv", text), {"nose": [1, 2, 3], "chin": NAN})
    turned = _read(tmp_path, ".csv", text, system="LPS")
    assert_array_equal(turned.point("nose"), [-1, -2, 3])


@pytest.mark.parametrize(
    "encode",
    [
        lambda text: text.encode("utf-8"),
        lambda text: codecs.BOM_UTF8 + text.encode("utf-8"),
        lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
        lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
        lambda text: text.encode("latin-1"),
    ],
    ids=["utf-8", "utf-8 with mark", "utf-16-le", "utf-16-be", "latin-1"],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_and_ends_of_lines(tmp_path, encode, end):
    text = end.join(["name;x;y;z", "Öhr;1;2;3", ""])
    _assert_are(_read(tmp_path, ".csv", encode(text)), {"Öhr": [1, 2, 3]})


# Faults: the file, the line, the remedy


@pytest.mark.parametrize(
    ("suffix", "text", "message"),
    [
        (".fcsv", "", "is empty. Export"),
        (".fcsv", "# nothing\n", "contains no landmarks. Export"),
        (".fcsv", "a\0b", "is not text.*UTF-8"),
        (".csv", codecs.BOM_UTF16_LE + b"a", "UTF-16-LE, but byte 0.*UTF-8"),
        (".fcsv", "1,2,3\n", "line 1: the line has 3 cells, but .*truncated"),
        (".fcsv", "# columns = id,x,y\n", "line 1: there is no column 'z' among id, x, y"),
        (".fcsv", "# CoordinateSystem = IJK\n", "line 1: the coordinate system 'IJK' is neither"),
        (".fcsv", "\n0,1,2,here,0,0,0,1,1,1,0,a,,\n", "line 2: 'here' is not a number. Write"),
        (".fcsv", "0,1,,3,0,0,0,1,1,1,0,a,,\n", "line 1: the landmark has only some of.*NA three"),
        (".mrk.json", '{\n"markups":', "is not valid JSON: .*line 2.*truncated"),
        (".mrk.json", "[" * 100_000, "is not valid JSON.*truncated"),
        (".mrk.json", "[]", "markups: it is not a list of markups.*Save the land"),
        (".mrk.json", '{"markups": []}', "contains no markup. Save the list"),
        (".mrk.json", '{"markups": [{"controlPoints": [{"label": "a"}]}]}', "point 1: it has the"),
        (".mrk.json", '{"markups": [{"controlPoints": 3}]}', "controlPoints: it is not a list"),
        (".mrk.json", '{"markups": [{"controlPoints": [3]}]}', "point 1: it is not a point"),
        (".mrk.json", '{"markups": [{"controlPoints": []}]}', "contains no landmarks"),
        (".mrk.json", _mrk([("a", [0, 0, 0], "lost")]), "point 1: the position has the status 'l"),
        (".mrk.json", _mrk([("a", [1, np.inf, 0], "defined")]), "point 1: 'inf' is not a number"),
        (".pp", "<PickedPoints>\n<point x=", "line 2: unclosed token.*truncated"),
        (".pp", "<html/>", "begins with <html>, but .*<PickedPoints>"),
        (".pp", PP.replace('"1.5"', '"far"'), "line 7: 'far' is not a number"),
        (".pp", '<!DOCTYPE a [<!ENTITY b "c">]><PickedPoints/>', "line 1: it declares XML ent"),
        (".tps", "1 2 3\n", "line 1: '1 2 3' is before the first LM3="),
        (".tps", "ID=3\n", "has no line LM3="),
        (".tps", "LM=2\n1 2\n3 4\n", "line 1: LM= begins two-dimensional landmarks"),
        (".tps", "LM3=two\n", "line 1: LM3=two is not a number of landmarks"),
        (".tps", "LM3=2\n1 2 3\n", "line 1: LM3=2, but 1 lines of coordinates.*truncated"),
        (".tps", "LM3=1\n1 2\n", "line 2: the line has 2 cells, but needs three"),
        (".tps", TPS, "line 3: the landmark has only some of"),
        (".tps", "LM3=1\n1 2 3\nSCALE=0\n", "in line 1: SCALE=0 is not a positive number"),
        (".tps", "LM3=1\n1 2 1e300\nSCALE=1e9\n", "line 2: .* multiplied by SCALE=1e.09.*Correct"),
        (".pts", "1 2 3\n", "line 1: .*begins with '1 2 3'.*rename it to .txt"),
        (".pts", "Version 1.0\nS0 1 2 3\n", "line 2: the number of points must follow"),
        (".pts", "Version 1.0\n2\nS0 1 2 3\n", "2 points are declared, but 1 follow"),
        (".pts", "Version 1.0\n1\nS0 1\n", "line 3: 'S0 1' is not a name with three coordinates"),
        (".csv", "some words\n", "line 1: 'some words' is neither a header.*name,x,y,z.*in quotes"),
        (".csv", "1,2\n", "line 1: '1,2' is neither"),
        (".csv", "1,5,2,5,3,5\n", "line 1: '1,5,2,5,3,5' is neither"),
        (".csv", "x,y,z\n", "contains no landmarks"),
        (".csv", "1,2,3\n4,5\n", "line 2: the line has 2 cells, but the first line has 3"),
        (".csv", "1,2,3\na,5,6\n", "line 2: 'a' is not a number"),
        (".csv", "7,1,2,3\n4,5,6,9\n", "line 1: the line has four numbers, and it is not"),
        (".csv", "x;y;z\n1,5;2;3\n1.234;2;3\n", "line 2: the line has decimal commas, but"),
        (".csv", "name,x,y,z\na,1,2,3\na,4,5,6\n", "same name: 'a' \\(line 2 and line 3"),
        (".csv", "x,y,z,radius\n1,2,3,wide\n", "line 2: 'wide' in column radius is not a number"),
        (".csv", "x,y,z,coverage\n1,2,3,0.9\n1,2,3,0.8\n", "different numbers in column coverage"),
    ],
)  # fmt: skip
def test_a_fault_names_the_file_the_line_and_the_remedy(tmp_path, suffix, text, message):
    with pytest.raises(CorrespondenceError, match=f"(?s){message}") as error:
        _read(tmp_path, suffix, text)
    assert f"cat_Landmarks{suffix}" in str(error.value)


@HUNTED
@given(
    cut=st.tuples(st.floats(0, 1), st.integers(0, 40)),
    other=st.sampled_from([b"", b"\0", b"\xe9", b"nan", b"1e308", b",", b'"', b"<", b"\n", b"-1"])
    | st.binary(max_size=3),
)
@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_damaged_file_is_read_or_named(tmp_path, predicted, suffix, cut, other):
    path = tmp_path / f"cat{suffix}"
    write_landmarks(predicted, path, overwrite=True)
    content = path.read_bytes()
    start = round(cut[0] * len(content))
    path.write_bytes(content[:start] + other + content[start + cut[1] :])
    try:
        said = f"{path}: {read_landmarks(path)}"
    except CorrespondenceError as error:
        said = str(error)
    assert str(path) in said


def test_what_is_no_landmark_file_is_refused(tmp_path):
    with pytest.raises(CorrespondenceError, match=r"suffix '.docx'; landmarks are read from .fcsv"):
        read_landmarks(tmp_path / "cat.docx")
    with pytest.raises(FileNotFoundError, match=r"no landmark file .*cat\.fcsv"):
        read_landmarks(tmp_path / "cat.fcsv")
    with pytest.raises(TypeError, match="path of a landmark file; got 3"):
        read_landmarks(3)
    with pytest.raises(ValueError, match="system must be one of"):
        _read(tmp_path, ".csv", "1,2,3\n", system="lps")


# Written and read again

NAMES = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Cn", "Zl", "Zp")), min_size=1
).filter(lambda name: name == name.strip())
NUMBERS = st.floats(allow_nan=False, allow_infinity=False).filter(
    lambda x: x not in {9999.0, -999.0, -9999.0}
)
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS) | st.just(tuple(NAN)), min_size=1, max_size=5)


@HUNTED
@given(rows=ROWS, data=st.data())
@pytest.mark.parametrize("suffix", WRITTEN)
def test_what_was_written_is_read_to_the_last_bit(tmp_path, suffix, rows, data):
    names = data.draw(st.lists(NAMES, min_size=len(rows), max_size=len(rows), unique=True))
    landmarks = Landmarks(rows, names, name="cat")
    path = tmp_path / f"cat{suffix}"
    write_landmarks(landmarks, path, overwrite=True)
    again = read_landmarks(path)
    assert_array_equal(again.points, landmarks.points)
    assert again.name == "cat"
    if suffix == ".tps":  # which holds no names
        assert again.names == Landmarks(rows).names
    else:
        assert again.names == landmarks.names


def test_a_table_keeps_expected_errors_radii_and_what_they_cover(tmp_path, predicted):
    write_landmarks(predicted, tmp_path / "cat.csv")
    again = read_landmarks(tmp_path / "cat.csv")
    for what in ("points", "expected_error", "radius"):
        assert_array_equal(getattr(again, what), getattr(predicted, what))
    assert again.coverage == predicted.coverage
    head = (tmp_path / "cat.csv").read_text().splitlines()[:3]
    assert head == [
        "name,x,y,z,expected_error,radius,coverage",
        "a,1.0,2.0,3.0,0.1,0.3333333333333333,0.9",
        "b,,,,,,0.9",
    ]


def test_points_of_slicer_are_described_by_their_errors(tmp_path, predicted):
    for suffix in (".fcsv", ".mrk.json"):
        write_landmarks(predicted, tmp_path / f"cat{suffix}")
    points = json.loads((tmp_path / "cat.mrk.json").read_text())["markups"][0]["controlPoints"]
    said = "expected error 0.1; within 0.3333 (90%)"
    assert [point["description"] for point in points][:2] == [said, ""]
    assert said in (tmp_path / "cat.fcsv").read_text()


@pytest.mark.parametrize("suffix", WRITTEN)
def test_no_file_is_overwritten_unasked(tmp_path, predicted, suffix):
    path = tmp_path / f"cat{suffix}"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match=r"already exists; .* overwrite=True"):
        write_landmarks(predicted, path)
    assert path.read_text() == "mine"
    write_landmarks(predicted, path, overwrite=True)
    assert_array_equal(read_landmarks(path).points, predicted.points)


def test_what_cannot_be_written_is_refused(tmp_path, predicted):
    with pytest.raises(TypeError, match=r"must be skfmap\.Landmarks; got list"):
        write_landmarks([1, 2, 3], tmp_path / "cat.csv")
    with pytest.raises(ValueError, match=r"suffix '.docx'; landmarks are written as .fcsv"):
        write_landmarks(predicted, tmp_path / "cat.docx")
    with pytest.raises(FileNotFoundError, match="There is no folder"):
        write_landmarks(predicted, tmp_path / "nowhere" / "cat.csv")
    for name in ("", " a", "a\n", "a\nb"):
        with pytest.raises(ValueError, match=re.escape(f"The name {name!r} cannot be written")):
            write_landmarks(Landmarks([[0, 0, 0]], [name]), tmp_path / "cat.csv")
    with pytest.raises(ValueError, match="There are no landmarks to write"):
        write_landmarks(Landmarks(np.empty((0, 3))), tmp_path / "cat.csv")
    assert not list(tmp_path.iterdir())


# Beside meshes


@pytest.fixture
def folder(tmp_path, collection):
    """Three bodies without landmarks."""
    for i, mesh in enumerate(collection.meshes[:3]):
        write_mesh(mesh, tmp_path / f"body{i}.off")
    return tmp_path


@pytest.fixture
def placed(collection):
    """Return landmarks at the same template points, in orders of their own."""

    def at(i, lacking=()):
        mesh, numbers = collection.meshes[i], np.roll(np.arange(40), i)
        points = mesh.vertices[collection.truths[i].pairs[numbers, 0]].copy()
        points[np.isin(numbers, list(lacking))] = np.nan
        return Landmarks(points, [f"L{j}" for j in numbers], name=f"body{i}")

    return at


def _partners(collection, i, numbers=range(40)):
    """Return the vertices of body i and body 0 at template points."""
    numbers = np.array(numbers)
    return {
        (int(collection.truths[i].pairs[j, 0]), int(collection.truths[0].pairs[j, 0]))
        for j in numbers
    }


def _joined(data, i):
    joined = data.correspondences[i].join(data.correspondences[0])
    return set(zip(joined.vertices_i.tolist(), joined.vertices_0.tolist(), strict=True))


@pytest.mark.parametrize(
    "names",
    [
        ("body0.fcsv", "body1_Landmarks.fcsv", "body2_LM.fcsv"),
        ("body0.mrk.json", "body1-landmarks.csv", "body2_picked_points.pp"),
        ("Body0_LANDMARKS.FCSV", "body1.pts", "body2.landmarks.mrk.json"),
    ],
)
def test_files_of_all_formats_are_found_and_go_together(folder, collection, placed, names):
    for i, name in enumerate(names):
        write_landmarks(placed(i), folder / name)
    data = load_collection(folder)
    for i in (1, 2):
        assert _joined(data, i) == _partners(collection, i)
        assert data.landmarks[i].name == f"body{i}"
        assert_array_equal(data.landmarks[i].points, placed(i).points)
    assert data.paths == [str(folder / f"body{i}.off") for i in range(3)]
    for name in names:
        assert f"NAME{name[5:]} for 1" in data.DESCR


def test_a_table_of_points_is_told_from_pairs(folder, collection, placed):
    for i in range(3):
        points = placed(i)
        table = np.column_stack([points.points, [name[1:] for name in points.names]])
        np.savetxt(folder / f"body{i}.txt", table, fmt="%s", header="x y z name")
    data = load_collection(folder)
    assert all(_joined(data, i) == _partners(collection, i) for i in (1, 2))
    for i in range(3):
        np.savetxt(folder / f"body{i}.txt", collection.truths[i].pairs[:40], fmt="%d")
    data = load_collection(folder)
    assert all(_joined(data, i) == _partners(collection, i) for i in (1, 2))
    assert data.landmarks == [None] * 3


def test_files_that_count_vertices_come_before_landmarks(folder, collection, placed):
    for i in range(3):
        write_landmarks(placed(i), folder / f"body{i}.fcsv")
        np.savetxt(folder / f"body{i}.txt", collection.truths[i].pairs[:7], fmt="%d")
    data = load_collection(folder)
    assert [len(truth.pairs) for truth in data.correspondences] == [7] * 3
    assert "NAME.txt for 3" in data.DESCR


def test_a_landmark_that_is_missing_is_missing_there_only(folder, collection, placed):
    for i in range(3):
        write_landmarks(placed(i, lacking=[5, 6] if i == 1 else []), folder / f"body{i}.fcsv")
    data = load_collection(folder)
    assert _joined(data, 1) == _partners(collection, 1, np.delete(np.arange(40), [5, 6]))
    assert _joined(data, 2) == _partners(collection, 2)
    assert (~data.landmarks[1].placed).sum() == 2


def test_the_other_system_of_coordinates_is_recognised_and_told(folder, collection, placed):
    for i in range(3):
        marks = placed(i)
        points = marks.points * ([-1, -1, 1] if i == 1 else 1)
        write_landmarks(Landmarks(points, marks.names), folder / f"body{i}.fcsv")
    with pytest.warns(RepairWarning, match=r"body1.*x and y .*negated.*the file says LPS"):
        data = load_collection(folder)
    assert _joined(data, 1) == _partners(collection, 1)
    assert_array_equal(data.landmarks[1].points, placed(1).points)


def test_the_scale_of_a_tps_file_is_applied_and_told(folder, collection, placed):
    for i in range(3):
        marks = Landmarks(placed(i).points[np.argsort(np.roll(np.arange(40), i))] / 0.5)
        write_landmarks(marks, folder / f"body{i}.tps")
        with (folder / f"body{i}.tps").open("a") as file:
            file.write("SCALE=0.5\n")
    data = load_collection(folder)
    assert all(_joined(data, i) == _partners(collection, i) for i in (1, 2))
    assert "coordinates were multiplied by SCALE=0.5 for 3" in data.DESCR


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (("body1.fcsv", "body1_LM.csv"), r"2 landmark files.*body1\.fcsv, body1_LM\.csv"),
        (("body2.fcsv",), r"for some meshes, but none for \['body1'\]"),
    ],
)
def test_two_files_for_one_mesh_and_none_are_refused(folder, placed, files, message):
    for name in ("body0.fcsv", "body2.fcsv", *files):
        write_landmarks(placed(int(name[4])), folder / name, overwrite=True)
    with pytest.raises(CorrespondenceError, match=message):
        load_collection(folder)
    with pytest.warns(SkippedShapeWarning, match=f"body1.*{message[:9]}"):
        data = load_collection(folder, on_invalid="skip")
    assert data.landmarks[1] is None
    assert data.landmarks[2] is not None


def test_landmarks_by_name_do_not_go_with_points_by_number(folder, collection, placed):
    for i in (0, 1):
        write_landmarks(placed(i), folder / f"body{i}.fcsv")
    np.savetxt(folder / "body2.txt", collection.truths[2].pairs, fmt="%d")
    message = r"'body2' has numbered points \(NAME.txt\), but 'body0' has named landmarks"
    with pytest.raises(CorrespondenceError, match=message):
        load_collection(folder)


def test_a_file_belongs_to_the_mesh_with_the_longest_name(tmp_path):
    ball = make_sphere(n_subdivisions=2)
    names = [f"L{i}" for i in range(9)]
    for i, stem in enumerate(("cat", "cat_points")):
        write_mesh(ball, tmp_path / f"{stem}.off")
        marks = Landmarks(ball.vertices[9 * i : 9 * i + 9], names)
        write_landmarks(marks, tmp_path / f"{stem}.csv")
    data = load_collection(tmp_path)
    assert [truth.pairs[0, 0] for truth in data.correspondences] == [0, 9]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not valid JSON"),
        (_mrk([("a", [0, 0, 0], "undefined")]), "holds no landmark that was placed"),
        (
            _mrk([("a", [0, 0, 0], "defined"), ("a", [0, 0, 1], "defined")]),
            "several points with the same name: 'a'",
        ),
        (
            _mrk([(f"L{j}", [50 + j / 1000, 50, 50], "defined") for j in range(9)]),
            r"The landmarks do not lie on shape 'body1'.*belongs to this specimen",
        ),
    ],
)
def test_a_file_with_a_fault_is_named(folder, placed, content, message):
    for i in (0, 2):
        write_landmarks(placed(i), folder / f"body{i}.mrk.json")
    (folder / "body1.mrk.json").write_text(content)
    with pytest.raises(CorrespondenceError, match=message) as error:
        load_collection(folder)
    assert "body1.mrk.json" in str(error.value)
    with pytest.warns(SkippedShapeWarning, match=message):
        load_collection(folder, on_invalid="skip")


def test_landmarks_that_lie_on_the_mesh_as_they_are_are_not_turned(tmp_path):
    """An egg is its own image when it is turned by half; one point is off by half its size."""
    ball = make_sphere(n_subdivisions=3)
    egg = Mesh(ball.vertices * [1, 1.3, 1.7], ball.faces, "egg")
    at = np.random.default_rng(0).choice(egg.n_vertices, 20, replace=False)
    points = egg.vertices[at] + 0.005
    write_landmarks(Landmarks(points), tmp_path / "egg.fcsv")
    found = landmarks_on(tmp_path / "egg.fcsv", egg)
    assert found.turned == ""
    assert_array_equal(found.landmarks.points, points)
    assert found.truth.distance.max() < 0.01
    points[3] *= 3
    write_landmarks(Landmarks(points), tmp_path / "egg.fcsv", overwrite=True)
    with pytest.raises(CorrespondenceError, match=r"egg\.fcsv: .*landmarks of .* lie farther.*'4'"):
        landmarks_on(tmp_path / "egg.fcsv", egg)


def test_a_landmark_lies_between_vertices(tmp_path):
    ball = make_sphere(n_subdivisions=2)
    weights = np.array([0.2, 0.3, 0.5])
    points = np.einsum("j,ijk->ik", weights, ball.vertices[ball.faces[:9]])
    for i in range(2):
        write_mesh(ball, tmp_path / f"ball{i}.off")
        write_landmarks(Landmarks(points), tmp_path / f"ball{i}.pp")
    data = load_collection(tmp_path)
    places = data.correspondences[1].places
    met = np.einsum("ij,ijk->ik", places.weights, ball.vertices[places.corners])
    assert_allclose(met, points, atol=1e-12)
    assert_allclose(np.sort(places.weights, axis=1), np.tile(weights, (9, 1)), atol=1e-9)


def test_landmarks_lie_on_files_without_vertex_numbers(folder, collection, placed):
    for i in range(3):
        (folder / f"body{i}.off").unlink()
        write_mesh(collection.meshes[i], folder / f"body{i}.stl")
        write_landmarks(placed(i), folder / f"body{i}.tsv.csv")
    with pytest.raises(CorrespondenceError, match="no correspondence files"):
        load_collection(folder)
    for i in range(3):
        (folder / f"body{i}.tsv.csv").rename(folder / f"body{i} landmarks.csv")
    data = load_collection(folder)
    for i, truth in enumerate(data.correspondences):
        vertices = data.meshes[i].vertices[truth.pairs[:, 0]]
        at = placed(i).points[[placed(i).names.index(truth.names[t]) for t in truth.pairs[:, 1]]]
        assert_allclose(vertices, at, atol=1e-6)


def test_points_of_one_name_have_one_number_in_all_correspondences(folder, placed):
    for i in range(3):
        write_landmarks(placed(i, lacking=range(i)), folder / f"body{i}.csv")
    truths = load_collection(folder).correspondences
    assert {truth.names for truth in truths} == {placed(0).names}
    assert set(truths[2].known_names) == {f"L{j}" for j in range(2, 40)}


def test_landmarks_without_a_name_in_common_are_refused(folder, placed):
    """3D Slicer calls points after their list, which is often called after the specimen."""
    for i in range(3):
        names = [f"{'F' if i < 2 else 'tom'}-{j}" for j in range(40)]
        write_landmarks(Landmarks(placed(i).points, names), folder / f"body{i}.fcsv")
    message = "'body2' and 'body0' have no landmark name in common: tom-0, .* against F-0, .*same"
    with pytest.raises(CorrespondenceError, match=message):
        load_collection(folder)


@pytest.mark.tosca
@pytest.mark.skipif(not (DATA / "mandibles").is_dir(), reason="the mandibles are not here")
def test_a_folder_of_mandibles_is_loaded_as_it_is():
    data = load_collection(DATA / "mandibles", "152_*")
    for mesh, marks, truth in zip(data.meshes, data.landmarks, data.correspondences, strict=True):
        file = DATA / "mandibles" / f"{mesh.name}_Landmarks.fcsv"
        assert marks.names == tuple(str(i) for i in range(1, 14))
        at = np.loadtxt(file, delimiter=",", usecols=(1, 2, 3), comments="#")
        assert_array_equal(marks.points, at)
        assert np.median(truth.distance) < 0.01 * np.ptp(mesh.vertices, axis=0).max()


@pytest.mark.tosca
@pytest.mark.skipif(not (DATA / "skulls").is_dir(), reason="the skulls are not here")
def test_a_broken_skull_is_loaded_with_its_landmarks():
    with pytest.warns(RepairWarning, match="WSB.*NaN"):
        data = load_collection(DATA / "skulls", "W*")
    assert len(data.correspondences[0].pairs) == len(data.landmarks[0].names) == 51
    assert np.isfinite(data.correspondences[0].distance).all()


# Landmarks themselves


def test_landmarks_are_numbered_where_they_have_no_names():
    marks = Landmarks([[0, 0, 0], NAN])
    assert marks.names == ("1", "2")
    assert marks.placed.tolist() == [True, False]
    assert repr(marks) == "Landmarks(None, n_landmarks=2, 1 missing)"


def test_repr_tells_the_mean_expected_error_of_what_is_there(predicted):
    assert repr(predicted) == "Landmarks('cat', n_landmarks=3, 1 missing, mean expected error 0.15)"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0]],), r"three coordinates in each row; got shape \(1, 2\)"),
        (([0, 0, 0],), r"got shape \(3,\)"),
        (([["a", "b", "c"]],), "points must hold real numbers"),
        (([[0, 0, 0], [0, np.nan, 0]],), "Row 1 of points holds .* only some of its coordinates"),
        (([[0, 0, np.inf]],), "Row 0 of points holds an infinite coordinate"),
        (([[0, 0, 0]], ["a", "b"]), "1 points but 2 names"),
        (([[0, 0, 0]], "a"), "sequence of names; got the string 'a'"),
        (([[0, 0, 0], [1, 1, 1]], ["a", "a"]), "Several landmarks have the same name: a"),
    ],
)
def test_what_landmarks_refuse(arguments, message):
    with pytest.raises(CorrespondenceError, match=message):
        Landmarks(*arguments)


@pytest.mark.parametrize("what", ["expected_error", "radius"])
def test_errors_are_one_for_each_point(what):
    with pytest.raises(CorrespondenceError, match=rf"{what} must have one entry .*\(2,\)"):
        Landmarks([[0, 0, 0]], **{what: [1, 2]})


def test_landmarks_are_copied_and_cannot_change(predicted):
    points = np.zeros((2, 3))
    marks = Landmarks(points)
    points[0] = 7
    assert_array_equal(marks.points, np.zeros((2, 3)))
    for array in (marks.points, predicted.expected_error, predicted.radius):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        marks.name = "dog"


def test_a_landmark_is_found_by_its_name(predicted):
    assert_allclose(predicted.point("c"), [4, 5, 6], rtol=0)
    with pytest.raises(KeyError, match=r"No landmark is called .*'d.*'\. The names are a, b, c"):
        predicted.point("d")


def _skops(landmarks):
    skops = pytest.importorskip("skops.io")
    content = skops.dumps(landmarks)
    assert set(skops.get_untrusted_types(data=content)) <= set(TRUSTED_TYPES)
    return skops.loads(content, trusted=list(TRUSTED_TYPES))


def _pickled(landmarks):
    return pickle.loads(pickle.dumps(landmarks))


@pytest.mark.parametrize("copied", [_pickled, copy.deepcopy, copy.copy, _skops])
def test_copies_hold_the_same(predicted, copied):
    again = copied(predicted)
    for what in ("points", "expected_error", "radius"):
        assert_array_equal(getattr(again, what), getattr(predicted, what))
    assert (again.names, again.name, again.coverage) == (predicted.names, "cat", 0.9)


@pytest.mark.parametrize("copied", [_pickled, copy.deepcopy, copy.copy])
def test_copies_cannot_change(predicted, copied):
    assert not copied(predicted).points.flags.writeable
