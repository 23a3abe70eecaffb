"""Every wrong document gets a ConfigError that names file, path, value and permitted values."""

from __future__ import annotations

import os
import re
import time
from contextlib import ExitStack

import pytest

from delta_calibration import files
from delta_calibration.documents import content_hash, read_document, write_document
from delta_calibration.errors import ConfigError
from delta_calibration.files import written_whole
from delta_calibration.robot import _schema, load_robot

ROBOT = load_robot("srbd").source
with open(ROBOT, encoding="utf-8") as _file:
    TEXT = _file.read()


def written(tmp_path, text):
    path = tmp_path / "cell.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(path):
    with pytest.raises(ConfigError) as caught:
        read_document(path, _schema)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert caught.value.exit_code == 2
    return message.removeprefix(f"{path}: ")


def test_the_file_as_it_is_is_read(tmp_path):
    data = read_document(written(tmp_path, TEXT), _schema)
    assert data["geometry"]["base_radius_mm"] == 200


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "  arm_mm: 320.0",
            "  arm_mm: long",
            r"geometry\.arm_mm: 'long' is not allowed; a number",
        ),
        ("  arm_mm: 320.0", "  arm_mm: true", r"geometry\.arm_mm: True is not allowed; a number"),
        ("  arm_mm: 320.0", "  arm_mm: [320.0]", r"geometry\.arm_mm: \[320\.0\] is not allowed"),
        ("  arm_mm: 320.0", "  arm_mm:", r"geometry\.arm_mm: None is not allowed; a number"),
        ("  arm_mm: 320.0", "  arm_mm: -320.0", r"geometry\.arm_mm: -320\.0 .* more than 0 is"),
        ("  arm_mm: 320.0", "  arm_mm: 1.0e+6", r"geometry\.arm_mm: 1000000\.0 .* at most 10000"),
        ("  arm_mm: 320.0", "  arm_mm: .nan", r"geometry\.arm_mm: nan is not a finite number"),
        ("  arm_mm: 320.0", "  arm_mm: .inf", r"geometry\.arm_mm: inf .*at most 10000"),
        (
            "gear_ratio: 33.0",
            "gear_ratio: .inf",
            r"joints\.gear_ratio: inf is not a finite number",
        ),
        ("gear_ratio: 33.0", "gear_ratio: 1" + "0" * 400, r"gear_ratio: 10+ is not a finite"),
        ("[joint_1, joint_2, joint_3]", "joint_1", r"joints\.names: 'joint_1' .* a list is"),
        ("[joint_1, joint_2, joint_3]", "[a, b, 3]", r"joints\.names\[2\]: 3 .* a text is"),
        ("tool:\n  offset_mm: [0.0, 0.0, 0.0]", "tool:", r"tool: None .* a mapping of keys to"),
        ("  arm_mm: 320.0", "", r"geometry: missing key arm_mm"),
        ("name: srbd", "", r"missing key name"),
        ("  arm_mm: 320.0", "  arm_m: 0.32", r"geometry: .*key arm_m"),
        ("name: srbd", "name: srbd\ncolour: red", r"unknown key colour; allowed: schema, name, "),
        (
            "mechanism: six_rod_delta",
            "mechanism: scara",
            r"mechanism: 'scara' .* choose from: rotary_",
        ),
        ("schema: 1", "schema: 2", r"schema: 2 is not allowed; it must be 1"),
        ("arm_centre: 0.45", "arm_centre: 1.45", r"masses\.arm_centre: 1\.45 .* at most 1 "),
        ("[joint_1, joint_2, joint_3]", "[a, b, b]", r"joints\.names: .* only once"),
        ("  arm_mm: 320.0", "  arm_mm: 3_20.0", r"line \d+, column 11: 3_20\.0 is not a number"),
        ("  arm_mm: 320.0", "  arm_mm: 3_20", r"line \d+, column 11: 3_20 is not a number"),
        ("name: srbd", "name: [", r"not valid YAML: line \d+, column \d+: "),
        (
            "name: srbd",
            "name: srbd\nname: srbd",
            r"not valid YAML: line 6, column 1: .*duplicate key",
        ),
        ("name: srbd", "name: srbd\nown: &a {own: *a}", r"alias \*a is used inside"),
        ("name: srbd", "\tname: srbd", r"not valid YAML: line 5, column 1: "),
        ("name: srbd", "name: !!python/name:os.system", r"not valid YAML"),
        ("name: srbd", "---\nname: srbd", r"not valid YAML|missing key"),
    ],
)
def test_a_wrong_entry_is_refused_by_path_and_value(tmp_path, old, new, message):
    assert TEXT.count(old) == 1
    assert re.search(message, refusal(written(tmp_path, TEXT.replace(old, new))))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a mapping of keys to values is expected, found nothing"),
        ("# nothing\n", "a mapping of keys to values is expected, found nothing"),
        ("- a\n- b\n", "a mapping of keys to values is expected, found a list"),
        ("just words", "a mapping of keys to values is expected, found text"),
        ("[" * 1500, "nested too deep: at most 40 levels are allowed"),
        ("&a [*a]", "not valid YAML: alias *a is used inside its own definition"),
        (b"\xff\xfe\x00name", "is in UTF-16; save it as UTF-8"),
    ],
)
def test_what_is_no_mapping_is_refused(tmp_path, text, message):
    assert message in refusal(written(tmp_path, text))


def test_what_cannot_be_opened_is_refused(tmp_path):
    assert refusal(tmp_path / "none.yaml") == "cannot be read: No such file or directory"
    assert refusal(tmp_path) == "cannot be read: Is a directory"


def test_hash_is_of_what_is_said_not_of_how():
    one = {"a": 1, "b": [1, 2.5], "c": {"d": 0, "e": "x"}}
    same = {"c": {"e": "x", "d": -0.0}, "b": [1.0, 2.5], "a": 1.0}
    assert content_hash(one) == content_hash(same)
    others = [
        {**one, "a": 2},
        {**one, "a": True},
        {**one, "a": "1"},
        {**one, "b": [2.5, 1]},
        {**one, "a": 1 + 1e-15},
        {**one, "f": 0},
    ]
    assert len({content_hash(other) for other in [one, *others]}) == 7


def test_robot_hash_ignores_comments_and_order_and_sees_every_value(tmp_path):
    nominal = load_robot("srbd").hash
    bare = re.sub(r" *#.*", "", TEXT).replace("320.0", "320").replace("0.25", "2.5e-1")
    sections = re.split(r"\n(?=\w)", bare.strip())
    turned = written(tmp_path, "\n".join(reversed(sections)) + "\n")
    assert load_robot(turned).hash == nominal
    for number in ("320.0", "0.15\n", "12.0 ", "0.45 ", "33.0", "20.0", "srbd\n"):
        assert TEXT.count(number) >= 1
        changed = number.replace(number.strip(), "other" if number == "srbd\n" else "0.4")
        other = written(tmp_path, TEXT.replace(number, changed, 1).replace("20.0", "20.5", 1))
        assert load_robot(other).hash != nominal


def test_written_is_read_again_and_nothing_else_is_left(tmp_path):
    data = read_document(written(tmp_path, TEXT), _schema)
    write_document(tmp_path / "again.yaml", data)
    assert read_document(tmp_path / "again.yaml", _schema) == data
    assert sorted(os.listdir(tmp_path)) == ["again.yaml", "cell.yaml"]


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = written(tmp_path, TEXT)
    monkeypatch.setattr(files, "token_hex", lambda _: "ab")
    (tmp_path / ".cell.yaml.ab.part").mkdir()  # no temporary file can be made, even by root
    with pytest.raises(ConfigError, match=r"cell\.yaml: cannot be written: "):
        write_document(path, {"a": 1})
    assert path.read_text(encoding="utf-8") == TEXT
    with pytest.raises(ConfigError, match=r"none/a\.yaml: cannot be written: No such file"):
        write_document(tmp_path / "none" / "a.yaml", {"a": 1})


def test_a_link_is_kept_and_the_file_at_its_end_is_written(tmp_path):
    link, real = tmp_path / "link.yaml", tmp_path / "real.yaml"
    link.symlink_to(real)  # nothing is there yet
    for value in (1, 2):
        write_document(link, {"a": value})
        assert link.is_symlink()
        assert real.read_text(encoding="utf-8") == f"{{a: {value}}}\n"


def test_what_is_no_file_is_not_replaced_by_one(tmp_path):
    pipe, folder = tmp_path / "pipe", tmp_path / "folder"
    os.mkfifo(pipe)
    folder.mkdir()
    with pytest.raises(ConfigError, match="pipe: cannot be written: is a pipe, a device"):
        write_document(pipe, {"a": 1})
    with pytest.raises(ConfigError, match="folder: cannot be written: is a folder"):
        write_document(folder, {"a": 1})
    assert pipe.is_fifo()


def test_two_that_write_the_same_file_do_not_mix(tmp_path):
    """The file always holds all that one of them wrote, however they overlap."""
    path, one, other = tmp_path / "c.yaml", ExitStack(), ExitStack()
    first = one.enter_context(written_whole(path))
    first.write_text("one")
    second = other.enter_context(written_whole(path)).open("w")
    second.write("oth")
    second.flush()
    one.close()
    assert path.read_text() == "one"
    second.write("er")
    second.close()
    other.close()
    assert path.read_text() == "other"


def test_a_huge_file_is_refused_before_it_is_parsed(tmp_path):
    path = tmp_path / "huge.yaml"
    path.write_text("a: [" + "1, " * 2_000_000 + "1]")
    began = time.monotonic()
    with pytest.raises(ConfigError, match=r"huge\.yaml: 6000006 bytes; no file of this kind"):
        read_document(path, lambda _: {})
    assert time.monotonic() - began < 2.0  # parsing takes minutes


def half_written(path, error, **how):
    with written_whole(path, **how) as beside:
        beside.write_text("half")
        raise error


def test_what_is_not_written_to_its_end_leaves_nothing(tmp_path):
    """Neither a file of that name nor a temporary one remains; an existing file is kept."""
    path = tmp_path / "table.csv"
    with pytest.raises(ZeroDivisionError):
        half_written(path, ZeroDivisionError())
    assert os.listdir(tmp_path) == []
    path.write_text("before")
    with pytest.raises(ConfigError, match=r"table\.csv: cannot be written: full"):
        half_written(path, OSError(28, "full"), kind=ConfigError, lasting=True)
    assert os.listdir(tmp_path) == ["table.csv"]
    assert path.read_text() == "before"
    with written_whole(path, lasting=True) as beside:
        beside.write_text("whole")
    assert path.read_text() == "whole"
    assert os.listdir(tmp_path) == ["table.csv"]
