"""Notes: each is worded once, with the data that its words name, and survives JSON."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from string import Formatter

import pytest
from project import ROOT

import modalmotion as mm
from modalmotion.classification.cases import LeftOut, left_out_notes
from modalmotion.notes import WORDS, Note, notes_as_json, notes_from_json


def uses() -> Iterator[tuple[str, ast.Call]]:
    """Every place where a note is made."""
    for folder in ("core", "service", "tools"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            if "Note.of" in source:
                for call in ast.walk(ast.parse(source)):
                    if isinstance(call, ast.Call) and ast.unparse(call.func) == "Note.of":
                        yield path.name, call


def test_each_note_gives_the_data_that_its_words_name() -> None:
    for name, call in uses():
        code, given = call.args[0], {keyword.arg for keyword in call.keywords}
        # Those of a table of checks are given theirs by code.
        if isinstance(code, ast.Constant):
            words = WORDS[str(code.value)]
            named = {field for _, field, _, _ in Formatter().parse(words) if field}
            assert given == named, (name, code.value)


def test_every_wording_is_used() -> None:
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "core").rglob("*.py")]
    sources += [path.read_text(encoding="utf-8") for path in (ROOT / "tools").rglob("*.py")]
    sources += [path.read_text(encoding="utf-8") for path in (ROOT / "service").rglob("*.py")]
    text = "\n".join(sources)
    assert [code for code in WORDS if text.count(f'"{code}"') < 2] == []


def test_json_and_back() -> None:
    notes = mm.modal_signature(
        mm.simulate_ventricle(), mm.SignatureParameters(modes=7, deviations=True)
    ).notes
    assert len(notes) > 1
    assert notes_from_json(json.loads(json.dumps(notes_as_json(notes)))) == notes


def test_a_case_that_was_left_out_is_named_in_words() -> None:
    _, note = left_out_notes([LeftOut("a {0}.npz", "it is {damaged}")])
    assert note.text == "Left out: a {0}.npz: it is {damaged}"
    assert notes_from_json(json.loads(json.dumps(notes_as_json([note])))) == (note,)


def test_words_and_data_are_read_apart() -> None:
    note = Note.of("vertices_isolated", n_vertices=3, first=7)
    assert note.code == "vertices_isolated"
    assert note.data == {"n_vertices": 3, "first": 7}
    assert str(note).startswith("3 vertices belong to no triangle (first: 7)")
    assert "nearest vertex" in note
    assert "triangle" not in Note.of("nothing_moves")


def test_a_code_that_nobody_worded_is_an_error_here() -> None:
    with pytest.raises(KeyError):
        Note.of("no_such_code")
