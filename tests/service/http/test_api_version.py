"""The interface has a version of its own, which rises whenever the interface changes."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner
from project import ROOT

from modalmotion_service.commands.openapi import document, main, require_version
from modalmotion_service.contract.changes import Change, change_between, least_version
from modalmotion_service.http.api_version import API_VERSION

FOLDER = ROOT / "openapi"


def described() -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((FOLDER / "openapi.json").read_text())
    return loaded


def test_the_interface_is_what_its_version_was_given_to() -> None:
    """Fails when openapi.json changes and API_VERSION does not: raise it, run `make openapi`."""
    assert described() == json.loads(document())
    assert described()["info"]["version"] == API_VERSION


def drop_call(document: dict[str, Any]) -> None:
    del document["paths"]["/v1/limits"]


def drop_parameter(document: dict[str, Any]) -> None:
    document["paths"]["/v1/sequences"]["get"]["parameters"].pop()


def drop_property(document: dict[str, Any]) -> None:
    del document["components"]["schemas"]["SequenceSummary"]["properties"]["unit"]


def retype_property(document: dict[str, Any]) -> None:
    document["components"]["schemas"]["SequenceSummary"]["properties"]["id"] = {"type": "integer"}


def require_parameter(document: dict[str, Any]) -> None:
    document["paths"]["/v1/sequences"]["get"]["parameters"][-1]["required"] = True


def change_scope(document: dict[str, Any]) -> None:
    document["paths"]["/v1/limits"]["get"]["x-scope"] = "admin"


def drop_content(document: dict[str, Any]) -> None:
    document["paths"]["/v1/sequences/{sequence_id}/signature"]["get"]["responses"]["200"][
        "content"
    ].pop("application/x-hdf5")


def add_call(document: dict[str, Any]) -> None:
    document["paths"]["/v1/new"] = copy.deepcopy(document["paths"]["/v1/sequences"])
    require = document["paths"]["/v1/new"]["get"]["parameters"][-1]
    require["required"] = True


def add_parameter(document: dict[str, Any]) -> None:
    parameter = {"name": "new", "in": "query", "schema": {"type": "string"}}
    document["paths"]["/v1/limits"]["get"].setdefault("parameters", []).append(parameter)


def add_property(document: dict[str, Any]) -> None:
    document["components"]["schemas"]["SequenceSummary"]["properties"]["new"] = {"type": "string"}


def reword(document: dict[str, Any]) -> None:
    document["paths"]["/v1/limits"]["get"]["description"] = "Limits."


BREAKS = [
    *(drop_call, drop_parameter, drop_property, retype_property, require_parameter),
    *(change_scope, drop_content),
]
ADDITIONS = [add_call, add_parameter, add_property]


@pytest.mark.parametrize(
    ("edit", "change"),
    [
        *((edit, Change.BREAK) for edit in BREAKS),
        *((edit, Change.ADDITION) for edit in ADDITIONS),
        (reword, Change.WORDS),
        (lambda _: None, Change.NONE),
    ],
)
def test_a_change_is_judged_by_what_it_means_to_clients(edit: Any, change: Change) -> None:
    new = described()
    edit(new)
    found, what = change_between(described(), new)
    assert found is change
    assert bool(what) == (change >= Change.ADDITION)
    assert change_between(described(), described())[0] is Change.NONE


@pytest.mark.parametrize(
    ("change", "least"),
    [
        (Change.NONE, "1.2.5"),
        (Change.WORDS, "1.2.6"),
        (Change.ADDITION, "1.3.0"),
        (Change.BREAK, "2.0.0"),
    ],
)
def test_the_least_version_raises_the_number_that_the_change_asks_for(
    change: Change, least: str
) -> None:
    assert least_version("1.2.5", change) == least


def test_a_changed_document_is_not_written_under_its_old_version(tmp_path: Path) -> None:
    old = described()
    drop_call(old)  # The code has one call more than this.
    path = tmp_path / "openapi.json"
    path.write_text(json.dumps(old))
    run = CliRunner().invoke(main, [str(path)])
    assert run.exit_code == 1
    assert "added: GET /v1/limits is there" in run.output
    assert json.loads(path.read_text()) == old
    path.unlink()
    assert CliRunner().invoke(main, [str(path)]).exit_code == 0
    assert CliRunner().invoke(main, [str(path), "--check"]).exit_code == 0
    path.write_text(json.dumps(old))
    assert CliRunner().invoke(main, [str(path), "--check"]).exit_code == 1


def test_a_raised_version_is_taken_and_a_used_one_is_not() -> None:
    old, new = described(), described()
    old["info"]["version"], new["info"]["version"] = "1.2.5", "1.3.0"
    add_parameter(new)
    require_version(old, new)
    new["info"]["version"] = "1.2.6"
    with pytest.raises(click.ClickException, match=r"at least 1\.3\.0"):
        require_version(old, new)
