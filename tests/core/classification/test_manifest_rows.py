"""Manifests as spreadsheets write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from format_samples import sequence

from modalmotion import Facts
from modalmotion.classification.manifest import labelled_files, manifest_rows, read_cases
from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.formats import write_vtkhdf
from modalmotion.formats.parser_process import ParserProcess

HEADING, ROWS = ("Path", "Subject", "Label"), (("a b.npz", "Müller, E.", "rest"), ("c.npz", "", ""))


def table(separator: str, newline: str = "\r\n", before: str = "", after: str = "") -> str:
    def cell(text: str) -> str:
        return f'"{text}"' if separator in text else text

    lines = [separator.join(map(cell, row)) for row in (HEADING, *ROWS)]
    return before + newline.join(lines) + newline + after


@pytest.mark.parametrize(
    "text",
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
        table(";").replace("rest\r\n", "rest;;; \r\n"),
        table("|", before="sep=|\n", newline="\n"),
    ],
)
def test_what_a_spreadsheet_saves_is_read(text: str) -> None:
    rows = [(row.path, row.subject, row.label) for row in manifest_rows(text, "cases.csv")]
    assert rows == [("a b.npz", "Müller, E.", "rest"), ("c.npz", None, None)]


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("path;subject\na.npz;P;x\n", 2, "more columns than headings"),
        ("sep=;\nname;subject\na.npz;P\n", 2, "has no column 'path'"),
        ("path,Path\na.npz,b.npz\n", 1, "two columns 'path'"),
        ("path,subject\n,P 1\n", 2, "has no path"),
        ('path,subject\n"a.npz,P 1\n', 2, "unexpected end of data"),
        ("path,covariate:age,covariate:age\na.npz,1,2\n", 1, "two columns"),
        ("path,period\na.npz,nan\n", 2, "period"),
        ("path,tracking\na.npz,tissue\n", 2, "tracking"),
    ],
)
def test_what_is_wrong_is_told_by_its_line(text: str, line: int, said: str) -> None:
    with pytest.raises(MalformedFileError, match=said) as caught:
        list(manifest_rows(text, "cases.csv"))
    assert caught.value.details["line"] == line


def test_columns_have_other_names_where_their_own_are_absent() -> None:
    [row] = manifest_rows("File,Class,patient\na.npz,rest,P 1\n", "cases.csv")
    assert (row.path, row.label, row.subject) == ("a.npz", "rest", "P 1")
    [row] = manifest_rows("path,file,label,class\na.npz,b.npz,rest,2\n", "cases.csv")
    assert (row.path, row.label) == ("a.npz", "rest")
    assert row.facts.covariates == {"file": "b.npz", "class": 2}


def test_facts_stand_in_columns_and_further_columns_are_covariates() -> None:
    text = (
        "path,Tracking,period,landmark:apex,covariate:Age,sex\n"
        'a.npz,normal_displacement,0.8,"0,0,-4",61,f\n'
    )
    facts = Facts(
        tracking="normal_displacement",
        period=0.8,
        landmarks={"apex": (0, 0, -4)},
        covariates={"Age": 61, "sex": "f"},
    )
    assert [row.facts for row in manifest_rows(text, "cases.csv")] == [facts]


def test_of_a_folder_with_a_table_the_table_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "cases.csv").write_text(table(","))
    with pytest.raises(ParameterError) as caught:
        labelled_files([tmp_path])
    assert "cases.csv" in caught.value.remedy


def test_the_files_of_a_table_share_a_parser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin, begun = ParserProcess.__init__, list[ParserProcess]()

    def counted(own: ParserProcess, *arguments: Any, **options: Any) -> None:
        begun.append(own)
        begin(own, *arguments, **options)

    monkeypatch.setattr(ParserProcess, "__init__", counted)
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.vtkhdf").write_bytes(write_vtkhdf(sequence()))
    (tmp_path / "t.csv").write_text("path,label\na.vtkhdf,x\nb.vtkhdf,y\nc.vtkhdf,y\n")
    read = [case.read() for case in read_cases(tmp_path / "t.csv")]
    assert [case.label for case in read] == ["x", "y", "y"]
    assert len(begun) <= 1
