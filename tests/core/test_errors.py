"""What is absent is answered with the command that installs it."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from training_cohort import cohort

import modalmotion as mm
from modalmotion.classification.training import joblib_backend
from modalmotion.cli import main
from modalmotion.client import Client
from modalmotion.errors import MissingExtraError, needs_extra
from modalmotion.formats import read_npz
from modalmotion.pictures.signature import signature_figure
from modalmotion_service.http.problems import problem_of

BEAT = next(cohort(1, seed=3)).body


def hide(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)


@pytest.mark.parametrize(
    ("package", "extra"),
    [
        ("matplotlib", "plot"),
        ("httpx2", "client"),
        ("distributed", "cluster"),
    ],
)
def test_an_absent_package_names_its_command(
    package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = read_npz(BEAT).sequence
    signature = mm.modal_signature(sequence)
    uses: dict[str, Callable[[], object]] = {
        "matplotlib": lambda: signature_figure(sequence, signature),
        "httpx2": lambda: Client("http://127.0.0.1:1"),
        "distributed": joblib_backend(scheduler="tcp://127.0.0.1:1").__enter__,
    }
    hide(monkeypatch, package)
    with pytest.raises(MissingExtraError) as caught:
        uses[package]()
    # Nobody has registered the name modalmotion: a package installs, an extra of it does not.
    assert caught.value.remedy == f"Install it: pip install {package}."
    assert caught.value.details["extra"] == extra
    again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301 (our own bytes)
    assert str(again) == str(caught.value)


def test_the_command_line_says_it_without_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beat.npz").write_bytes(BEAT)
    hide(monkeypatch, "matplotlib")
    arguments = ["signature", str(tmp_path / "beat.npz"), "--plot", str(tmp_path / "beat.png")]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 1
    assert "pip install matplotlib." in done.output


def test_over_http_it_is_501() -> None:
    with pytest.raises(MissingExtraError) as caught, needs_extra("plot"):
        raise ModuleNotFoundError(name="matplotlib")
    answer = problem_of(caught.value)
    assert answer.status_code == 501
    assert answer.media_type == "application/problem+json"
