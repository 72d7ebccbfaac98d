"""What `deploy/` hands to Prometheus fits what the service tells it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from fastapi.testclient import TestClient
from project import ROOT
from prometheus_client.parser import text_string_to_metric_families

from modalmotion.store import ResultStore
from modalmotion_service.access.scopes import Scope
from modalmotion_service.app import create_app
from modalmotion_service.monitoring import metrics as readiness
from modalmotion_service.settings import Settings

DEPLOY = ROOT / "deploy"


def figures(client: TestClient) -> dict[str, list[tuple[dict[str, str], float]]]:
    """Samples by name, as Prometheus reads them."""
    found: dict[str, list[tuple[dict[str, str], float]]] = {}
    for family in text_string_to_metric_families(client.get("/metrics").text):
        for sample in family.samples:
            found.setdefault(sample.name, []).append((sample.labels, sample.value))
    return found


def rules() -> list[dict[str, Any]]:
    loaded = yaml.safe_load((DEPLOY / "prometheus-alerts.yml").read_text())
    return [rule for group in loaded["groups"] for rule in group["rules"]]


def test_alerts_are_about_figures_and_labels_that_there_are(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0)
    with TestClient(create_app(settings)) as client:
        client.post("/v1/sequences", content=beat)
        client.post("/v1/sequences", content=b"nonsense")
        client.post("/v1/sequences", content=beat, headers={"Prefer": "respond-async"})
        found = figures(client)
    assert len({rule["alert"] for rule in rules()}) == len(rules()) > 8
    for rule in rules():
        assert rule["labels"]["severity"] in ("page", "ticket")
        assert rule["annotations"]["summary"].endswith(".")
        assert rule["annotations"]["remedy"]
        names = re.findall(r"modalmotion_\w+", rule["expr"])
        assert names or rule["expr"].startswith("up{")
        for name in names:
            assert name in found, rule["alert"]
        for name, labels in re.findall(r"(modalmotion_\w+)\{([^}]*)\}", rule["expr"]):
            there = {label for sample, _ in found[name] for label in sample}
            assert set(re.findall(r"(\w+)=", labels)) <= there, rule["alert"]
            route = re.search(r'route="([^"]*)"', labels)
            if route is not None:
                assert route[1] in {sample["route"] for sample, _ in found[name]}


def test_what_is_scraped_is_told_to_the_scope_that_the_file_names() -> None:
    text = (DEPLOY / "prometheus.yml").read_text()
    (scrape,) = yaml.safe_load(text)["scrape_configs"]
    assert scrape["job_name"] == "modalmotion"
    assert yaml.safe_load(text)["rule_files"] == ["prometheus-alerts.yml"]
    scopes = re.search(r"--scopes (\S+)", text)
    assert scopes is not None
    assert Scope(scopes[1]) is Scope.METRICS


def test_readiness_the_process_and_closed_stores_are_among_the_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ResultStore(tmp_path / "owners" / "lab"):
        pass
    (tmp_path / "owners" / "lab" / "index.sqlite").write_bytes(b"no database" * 1000)
    with ResultStore(tmp_path / "owners" / "ward"):
        pass
    with TestClient(create_app(Settings(data_dir=tmp_path, workers=1))) as client:
        found = figures(client)
        assert found["modalmotion_ready"] == [({}, 1.0)]
        assert found["modalmotion_owners"] == [({}, 2.0)]
        assert found["modalmotion_owners_failed"] == [({}, 1.0)]
        ((build, one),) = found["modalmotion_build_info"]
        assert (build["version"], one) == (client.get("/health/live").json()["version"], 1.0)
        assert found["process_resident_memory_bytes"][0][1] > 10e6
        assert found["process_open_fds"][0][1] > 5
        monkeypatch.setattr(readiness, "require_room", _is_full)
        assert figures(client)["modalmotion_ready"] == [({}, 0.0)]


def _is_full(_: Path) -> None:
    from modalmotion.errors import StoreError

    raise StoreError("The disk is full.")
