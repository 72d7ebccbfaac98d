"""The command that fits the signatures of a cohort."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.analysis_commands import signature
from modalmotion.cli.options import example, json_option, signature_parameters, tell
from modalmotion.cli.outputs import OutputFile, OutputFolder
from modalmotion.cli.store_commands import require_all_packed
from modalmotion.exports.signature_pack import PackReport, export, is_pack
from modalmotion.formats import ReadOptions
from modalmotion_service.cohort import CohortJob, read_manifest, sign_cohort
from modalmotion_service.cohort.remote import RemoteFile, Source, is_url, source_of
from modalmotion_service.cohort.transfer import require_target, send
from modalmotion_service.environment import read_settings
from modalmotion_service.work.engine import open_engine

_STATED = ("unit", "format", "frame_interval", "n_vertices", "topology", "grid")
_PARAMETERS = (
    *("modes", "kind", "reference", "weights", "merge_vertices", "components", "remove_rotation"),
)

_MOST_PRINTED = 50


class _SourceType(click.Path):
    """A path of this machine, or a URL."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Keep a URL whole: a path has no two slashes."""
        if is_url(str(value)):
            return source_of(str(value))
        return super().convert(value, param, ctx)


class _PackType(OutputFile):
    """A file of this machine, or a URL."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Check that it can be written, or that what is there may be replaced."""
        target = source_of(str(value))
        if isinstance(target, RemoteFile):
            require_target(target)
            return target
        return super().convert(value, param, ctx)


@click.command(epilog=example("cohort cases.csv -o results --pack cohort.h5"))
@click.argument("manifest", type=_SourceType(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=OutputFolder(),
    help="Folder of results; made if missing, continued if not.",
)
@click.option("--scheduler", help="Dask scheduler to send work to, such as tcp://host:8786.")
@click.option("--workers", type=click.IntRange(1, 256), help="Processes here, without one.")
@click.option("--batch", type=click.IntRange(1, 1000), help="Files in one piece of work.")
@click.option(
    "--template-from",
    type=click.Path(exists=True, path_type=Path),
    help="Sequence whose reference frame gives one template for all.",
)
@click.option("--keep-vertices", is_flag=True, help="Keep the sequences too, not only results.")
@click.option(
    "--pack",
    type=_PackType(),
    help="HDF5 file with them all, or its URL; one of an earlier run is made anew.",
)
@click.option(
    "--patience",
    default=120.0,
    show_default=True,
    type=click.FloatRange(min=0),
    help="Seconds to wait for a scheduler that is lost.",
)
@click.option(
    "--skip-unreadable", is_flag=True, help="Files that fail do not make the command fail."
)
@json_option
def cohort(
    manifest: Source,
    output: Path,
    scheduler: str | None,
    workers: int | None,
    batch: int | None,
    template_from: Path | None,
    keep_vertices: bool,
    pack: Source | None,
    patience: float,
    skip_unreadable: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Fit a signature to every sequence in MANIFEST.

    MANIFEST is a .csv file (columns path, subject, label; the last two may be missing), a .jsonl
    file of such objects, a folder, or a pattern such as 'scans/*.npz'. It may be a URL, such as
    s3://bucket/scans, and so may the paths in it; results stay here. Given again after an
    interruption, the command does what is unfinished. It ends with 1 if a file failed, unless
    such files are skipped; the others are done then all the same.
    """
    settings = read_settings()
    if workers is not None:
        settings = settings.model_copy(update={"workers": workers, "scheduler": None})
    if scheduler is not None:
        settings = settings.model_copy(update={"scheduler": scheduler})
    stated = {name: options[name] for name in _STATED}
    reading = ReadOptions(limits=settings.read_limits, **stated)
    parameters = signature_parameters(options)
    # That of an earlier run is made anew, as the same command does what failed then.
    if isinstance(pack, Path) and pack.exists() and not is_pack(pack):
        raise click.BadParameter(
            f"{pack} exists already and is not a pack of signatures.", param_hint="--pack"
        )
    job = CohortJob(
        entries=read_manifest(manifest, settings.max_body_bytes),
        folder=output,
        parameters=parameters,
        options=reading,
        template_from=template_from,
        keep_vertices=keep_vertices,
        batch=batch,
        max_file_bytes=settings.max_body_bytes,
        patience_seconds=patience,
    )
    with click.progressbar(length=len(job.entries), label="signatures", file=sys.stderr) as bar:
        report = sign_cohort(
            job,
            lambda folder: open_engine(settings, folder),
            lambda done, _: bar.update(done - bar.pos),
        )
    said = (
        f"{report.n_made} signatures made in {report.seconds:.1f} s, {report.n_known} known "
        f"before, {len(report.failures)} files failed: {output}"
    )
    answer = asdict(report) | {"failures": [list(map(str, one)) for one in report.failures]}
    if not as_json:
        click.echo(said)
    for path, reason in report.failures[:_MOST_PRINTED]:
        click.echo(f"{path}: {reason}", err=True)
    if len(report.failures) > _MOST_PRINTED:
        click.echo(f"... all of them stand in {output / 'cohort.csv'}", err=True)
    packed = None
    # After the failures of files, which a pack that cannot be written must not hide.
    if pack is not None and (report.n_made or report.n_known):
        packed = _pack(output, pack)
        answer |= {"n_packed": packed.n_signatures, "pack": str(pack)}
        if not as_json:
            click.echo(f"{packed.n_signatures} signatures packed: {pack}")
    if as_json:
        tell(answer, [], as_json=True)
    if packed is not None:
        require_all_packed(packed)
    if report.failures and not skip_unreadable:
        raise click.exceptions.Exit(1)


def _pack(root: Path, pack: Source) -> PackReport:
    if isinstance(pack, Path):
        return export(root, pack, replace=True)
    with tempfile.TemporaryDirectory(dir=root / "spool") as folder:
        packed = export(root, Path(folder) / "pack.h5")
        send(Path(folder) / "pack.h5", pack)
    return packed


# Each option of a signature has one definition.
cohort.params += [option for option in signature.params if option.name in (*_STATED, *_PARAMETERS)]
