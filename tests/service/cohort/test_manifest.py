"""Manifests as spreadsheets write them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from modalmotion import Facts
from modalmotion.errors import MalformedFileError
from modalmotion.facts import facts_as_json
from modalmotion_service.cohort import read_manifest

HEADING, ROWS = ("Path", "Subject", "Label"), (("a b.npz", "Müller, E.", "rest"), ("c.npz", "", ""))


def table(separator: str, newline: str = "\r\n", before: str = "", after: str = "") -> bytes:
    def cell(text: str) -> str:
        return f'"{text}"' if separator in text else text

    lines = [separator.join(map(cell, row)) for row in (HEADING, *ROWS)]
    return (before + newline.join(lines) + newline + after).encode()


@pytest.mark.parametrize(
    "content",
    [
        table(","),
        table(";"),
        table("\t"),
        table(";", newline="\n"),
        table(";", before="\ufeff"),
        table(";", before="sep=;\r\n"),
        table(",", before="\ufeffsep=,\r\n"),
        # Rows below the table and columns beside it, once used and emptied.
        table(";", after=";;\r\n;;;;;\r\n\r\n"),
        table(";").replace(b"rest\r\n", b"rest;;; \r\n"),
        table("|", before="sep=|\n", newline="\n"),
    ],
)
@pytest.mark.parametrize("name", ["scans.csv", "SCANS.CSV"])
def test_what_a_spreadsheet_saves_is_read(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    first, second = read_manifest(tmp_path / name)
    assert first.path == tmp_path / "a b.npz"
    assert (first.subject, first.label) == ("Müller, E.", "rest")
    assert second.path == tmp_path / "c.npz"
    assert (second.subject, second.label) == (None, None)


@pytest.mark.parametrize(
    ("content", "line", "said"),
    [
        (b"path;subject\na.npz;P;x\n", 2, "more columns than headings"),
        (b"sep=;\npath;subject\na.npz;P\na.npz;P\n", 4, "stands in line 3 already"),
        (b"sep=;\nfile;subject\na.npz;P\n", 2, "has no column 'path'"),
        (b"path,Path\na.npz,b.npz\n", 1, "two columns 'path'"),
        (b"path,subject\n,P 1\n", 2, "there is no path"),
        (b'path,subject\n"a.npz,P 1\n', 2, "unexpected end of data"),
    ],
)
def test_what_is_wrong_is_told_by_its_line(
    tmp_path: Path, content: bytes, line: int, said: str
) -> None:
    (tmp_path / "scans.csv").write_bytes(content)
    with pytest.raises(MalformedFileError, match=said) as caught:
        read_manifest(tmp_path / "scans.csv")
    assert caught.value.details == {"line": line}


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_what_is_no_utf8_is_told_in_a_spreadsheets_words(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "scans.csv").write_bytes(table(";").decode().encode(encoding))
    with pytest.raises(MalformedFileError, match="not UTF-8") as caught:
        read_manifest(tmp_path / "scans.csv")
    assert "CSV UTF-8" in caught.value.remedy


def test_a_manifest_that_is_missing_is_not_said_to_be_no_text(tmp_path: Path) -> None:
    with pytest.raises(MalformedFileError, match="No such file") as caught:
        read_manifest(tmp_path / "scans.csv")
    assert "UTF-8" not in caught.value.remedy


def test_facts_stand_in_columns_and_objects(tmp_path: Path) -> None:
    facts = Facts(
        tracking="offset", period=0.8, landmarks={"apex": (0, 0, -4)}, covariates={"Age": 61}
    )
    rows = tmp_path / "m.csv"
    rows.write_text(
        'path,Tracking,period,landmark:apex,covariate:Age\na.npz,offset,0.8,"0,0,-4",61\n'
    )
    lines = tmp_path / "m.jsonl"
    row = {"path": "a.npz", **facts_as_json(facts)}
    lines.write_text(json.dumps(row) + "\n")
    for manifest in (rows, lines):
        assert [entry.facts for entry in read_manifest(manifest)] == [facts]


@pytest.mark.parametrize(
    "text",
    [
        "path,covariate:age,covariate:age\na.npz,1,2\n",
        "path,covariate:age,covariate:AGE\na.npz,1,2\n",
        "path,period\na.npz,nan\n",
        "path,tracking\na.npz,tissue\n",
        "path,handedness,coordinates\na.npz,left,LPS\n",
    ],
)
def test_a_bad_fact_names_its_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(MalformedFileError, match=r"Line [12] of"):
        read_manifest(tmp_path / "m.csv")


def test_further_columns_are_covariates(tmp_path: Path) -> None:
    rows, lines = tmp_path / "m.csv", tmp_path / "m.jsonl"
    rows.write_text("path;Age;sex;remark\na.npz;61,5;f;\nb.npz;NA;m;late\n")
    objects = [
        {"path": "a.npz", "age": 61.5, "sex": "f", "remark": None},
        {"path": "b.npz", "sex": "m", "remark": "late"},
    ]
    lines.write_text("".join(json.dumps(row) + "\n" for row in objects))
    stated = [{"age": 61.5, "sex": "f"}, {"sex": "m", "remark": "late"}]
    for manifest in (rows, lines):
        assert [dict(e.facts.covariates) for e in read_manifest(manifest)] == stated
