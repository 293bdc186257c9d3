"""Tables with rows of installed packages, added by entry point."""

import sys

import pytest

from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.plugins import Table

GROUP = "equipoise.fruits"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Create packages that appear installed."""

    def install(name, code, *entries):
        place = tmp_path / name
        folder = place / f"{name}-1.2.dist-info"
        folder.mkdir(parents=True)
        (place / f"{name}_code.py").write_text(code, encoding="utf-8")
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n", encoding="utf-8")
        lines = "\n".join((f"[{GROUP}]", *entries))
        (folder / "entry_points.txt").write_text(lines + "\n", encoding="utf-8")
        monkeypatch.syspath_prepend(str(place))

    yield install
    for name in [name for name in sys.modules if name.endswith("_code")]:
        del sys.modules[name]


def table():
    return Table("fruit", GROUP, str, {"apple": f"{__name__}:APPLE"})


APPLE = "an apple"


def test_built_in_rows_are_imported_on_use():
    assert list(table()) == ["apple"]
    assert table()["apple"] == "an apple"
    assert "apple" in table()
    assert "pear" not in table()
    assert list(Table("fruit", GROUP, str, {"apple": "no.such.module:X"})) == ["apple"]


def test_a_package_adds_a_row_that_is_loaded_on_use(install):
    install("orchard", "PEAR = 'a pear'", "pear = orchard_code:PEAR")
    fruits = table()
    assert list(fruits) == ["apple", "pear"]
    assert "pear" in fruits
    assert "orchard_code" not in sys.modules
    assert fruits["pear"] == "a pear"


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import no_such_thing", "'rotten_code:PEAR' fails (ModuleNotFoundError: No module named 'no_such_thing')"),
        ("raise SystemExit('bye')", "'rotten_code:PEAR' fails (SystemExit: bye)"),
        ("", "'rotten_code:PEAR' fails (AttributeError: module 'rotten_code' has no attribute 'PEAR')"),
        ("PEAR = 3", "'rotten_code:PEAR' is of type int; it must be str"),
    ],
)
def test_a_package_that_fails_is_refused_by_name_and_others_work(install, code, reason):
    install("rotten", code, "pear = rotten_code:PEAR")
    install("orchard", "PLUM = 'a plum'", "plum = orchard_code:PLUM")
    fruits = table()
    with pytest.raises(MissingDependencyError) as caught:
        fruits["pear"]
    assert str(caught.value).startswith(f"fruit 'pear' of the package rotten 1.2 cannot be used: {reason}")
    rows = fruits.rows()
    assert (rows["apple"], rows["plum"], str(rows["pear"])) == ("an apple", "a plum", str(caught.value))


def test_a_name_that_is_defined_twice_is_refused(install):
    install("orchard", "X = 'x'", "pear = orchard_code:X", "apple = orchard_code:X")
    install("grove", "X = 'x'", "pear = grove_code:X", "plum = grove_code:X")
    fruits = table()
    assert list(fruits) == ["apple", "pear", "plum"]
    with pytest.raises(SettingsError) as caught:
        fruits["apple"]
    message = "fruit 'apple' is defined twice, by equipoise and orchard 1.2; uninstall or rename one"
    assert str(caught.value) == message
    with pytest.raises(
        SettingsError, match=r"'pear' is defined twice, by (orchard|grove) 1\.2 and (orchard|grove) 1\.2;"
    ):
        fruits["pear"]
    assert fruits["plum"] == "x"


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(SettingsError, match=r"^fruit 'pear' is unknown; it must be one of apple$"):
        table()["pear"]
