"""Tracking without correspondence: real clouds and contours, stated deviations, peers, time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measure import Table
from numpy.typing import NDArray
from tracking_contours import real_contours, simulated_contours

from modalmotion.classification import classify, load_model
from modalmotion.classification.model.shipped import OFFSET_MODEL
from modalmotion.facts import Facts
from modalmotion.formats import read_npz
from modalmotion.mesh import cavity_of, face_normals
from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.mesh.standard_surfaces import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import SPHERE
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.simulate import simulate_cohort
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track, of_surface, track
from modalmotion.tracking.closest import closest_points

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
N_POINTS = 2000
N_VENTRICLES = 200
N_PEER = 1000
N_OF_EACH_CLASS = 10

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Frames = Sequence[Sequence[Observation]]


def run(_folder: Path) -> list[Table]:
    """Measure everything."""
    tables = [
        simulated_contours(),
        closed(),
        stated(N_VENTRICLES),
        classes(N_OF_EACH_CLASS),
    ]
    if (DATA / "heart" / "lv_endocardium.npz").is_file():
        tables = [clouds(), remeshed(), real_contours(DATA), peers(), *tables]
    return tables


@dataclass(frozen=True)
class Truth:
    """A surface that is known in every frame, with the landmarks of its ends."""

    vertices: Floats
    faces: Ints
    ends: tuple[tuple[int, ...], ...]

    @staticmethod
    def of(sequence: MeshSequence) -> Truth:
        """Take the apex and the middle of each opening as landmarks; none of a closed surface."""
        template = make_template(sequence)
        cavity = cavity_of(template.faces, template.n_vertices)
        ends: list[tuple[int, ...]] = []
        if cavity.openings:
            s = template.coordinates[:, 0]
            rims = [np.unique(edges) for edges in cavity.openings]
            ends = [(int(s.argmin()),)]
            ends += [tuple(rim.tolist()) for rim in rims if s[rim].mean() > 0.5]
        return Truth(sequence.vertices.astype(np.float64), template.faces, tuple(ends))

    def seen(
        self, n: int, noise: float, rng: np.random.Generator, strays: float = 0.0
    ) -> list[list[Observation]]:
        """Random points of each frame, and the landmarks, with noise."""
        frames = []
        for x in self.vertices:
            cloud = sampled(x, self.faces, n, rng) + rng.normal(0.0, noise, (n, 3))
            k = round(strays * n)
            cloud[:k] = rng.uniform(cloud.min(axis=0) - 10, cloud.max(axis=0) + 10, (k, 3))
            frames.append([Observation(cloud)])
            for end in self.ends:
                sd = max(noise / len(end) ** 0.5, 0.1)
                place = x[list(end)].mean(axis=0) + rng.normal(0.0, noise / len(end) ** 0.5, 3)
                frames[-1].append(Observation(place[None], sd=sd, places=(end,)))
        return frames

    def start(self) -> MeshSequence:
        """Return the surface of frame 0."""
        return mesh_sequence(self.vertices[:1], self.faces, unit="mm")

    @property
    def ejection_fraction(self) -> float:
        """Percent."""
        v = np.abs(cavity_of(self.faces, self.vertices.shape[1]).volume(self.vertices))
        return float(100.0 * (1.0 - v.min() / v.max()))


def sampled(x: Floats, faces: Ints, n: int, rng: np.random.Generator) -> Floats:
    areas = np.linalg.norm(face_normals(x, faces), axis=1)
    corners = x[faces[rng.choice(len(faces), n, p=areas / areas.sum())]]
    points: Floats = (rng.dirichlet(np.ones(3), n)[:, :, None] * corners).sum(axis=1)
    return points


def surface_distance(x: Floats, faces: Ints, y: Floats, others: Ints) -> tuple[float, float]:
    """Mean distance and 95 % Hausdorff distance of two surfaces, both ways."""
    rng = np.random.default_rng(0)
    one = closest_points(sampled(x, faces, 4000, rng), y, others).distances
    two = closest_points(sampled(y, others, 4000, rng), x, faces).distances
    hausdorff = max(float(np.quantile(d, 0.95)) for d in (one, two))
    return float(one.mean() + two.mean()) / 2, hausdorff


@dataclass(frozen=True)
class Score:
    """Errors of a track against what is known."""

    mean: float
    hausdorff: float
    fraction: float
    vertices: float

    @staticmethod
    def of(result: Track, truth: Truth) -> Score:
        """Compare surfaces in every other frame, vertices in all."""
        faces = result.template.faces
        found = result.sequence.vertices.astype(np.float64)
        both = [
            surface_distance(found[k], faces, truth.vertices[k], truth.faces)
            for k in range(0, len(found), 2)
        ]
        off = np.nan
        if found.shape == truth.vertices.shape:
            squares = ((found - truth.vertices) ** 2).sum(axis=2) @ result.template.weights
            off = float(np.sqrt(squares).mean())
        fraction = (result.ejection_fraction or 0.0) - truth.ejection_fraction
        mean, hausdorff = np.mean(both, axis=0)
        return Score(float(mean), float(hausdorff), fraction, off)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a call and its processor seconds."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start


def clouds() -> Table:
    truth = Truth.of(_real("heart/lv_endocardium"))
    table = Table(
        f"Real left ventricle, {N_POINTS:,} points a frame and 3 landmarks, 37 modes",
        ("data", "figure", "value"),
    )
    clean: Score | None = None
    for name, noise, strays, bounds in (
        ("clean", 0.0, 0.0, (0.20, 0.7, 0.5, 1.7)),
        ("noise 1 mm", 1.0, 0.0, (0.25, 0.8, 0.8, 1.9)),
        ("noise 1 mm, 30 % strays", 1.0, 0.3, None),
    ):
        frames = truth.seen(N_POINTS, noise, np.random.default_rng(0), strays)
        result, seconds = timed(partial(track, frames, start=truth.start(), unit="mm"))
        score = Score.of(result, truth)
        values = (score.mean, score.hausdorff, abs(score.fraction), score.vertices)
        names = ("surface, mean mm", "surface, 95 % mm", "EF off, points", "vertices, RMS mm")
        for k, (figure, value) in enumerate(zip(names, values, strict=True)):
            if bounds is not None:
                table.add_at_most(value, bounds[k], name, figure, f"{value:.3f}")
            elif k == 0 and clean is not None:
                table.add_at_most(
                    value / clean.mean,
                    1.2,
                    name,
                    "mean over that without",
                    f"{value / clean.mean:.3f}",
                )
            else:
                table.add(name, figure, f"{value:.3f}")
        bound = result.ejection_fraction_bound or 0.0
        table.add(name, "EF bound stated, points", f"{bound:.2f}")
        table.add_at_most(
            seconds / len(frames), 0.2, name, "s a frame", f"{seconds / len(frames):.3f}"
        )
        clean = score
    return table


def remeshed() -> Table:
    """Each frame has other vertices and other triangles."""
    sequence = _real("heart/lv_endocardium")
    truth, rng = Truth.of(sequence), np.random.default_rng(1)
    frames = []
    for x, marks in zip(truth.vertices, truth.seen(10, 0.0, rng), strict=True):
        # Other vertices: centroids; other triangles: around them, their places drawn anew.
        middles = x[truth.faces].mean(axis=1)
        order = rng.permutation(len(middles))
        frames.append([Observation(middles[order]), of_surface(x, truth.faces), *marks[1:]])
    result = track(frames, start=truth.start(), unit="mm")
    parameters = SignatureParameters(kind=SignatureKind.OFFSET)
    own = modal_signature(sequence, parameters).amplitudes
    found = modal_signature(result.sequence, parameters).amplitudes
    off = float(np.linalg.norm(found - own) / np.linalg.norm(own))
    table = Table("Remeshed in every frame", ("figure", "value"))
    table.add_at_most(off, 0.05, "offset signature, relative", f"{off:.4f}")
    return table


def peers() -> Table:
    """One pair of frames, end diastole to end systole: others' best beside ours."""
    truth = Truth.of(_real("heart/lv_endocardium"))
    volumes = np.abs(cavity_of(truth.faces, truth.vertices.shape[1]).volume(truth.vertices))
    pair = Truth(truth.vertices[[0, int(volumes.argmin())]], truth.faces, truth.ends)
    rng = np.random.default_rng(0)
    table = Table(
        f"One pair of frames, {N_PEER:,} points, 1 mm of noise",
        ("method", "surface mm", "EF off", "vertices mm", "s"),
    )
    frames = pair.seen(N_PEER, 1.0, rng)
    cloud = frames[1][0].points

    def add(name: str, x: Floats, seconds: float) -> None:
        mean, _ = surface_distance(x, pair.faces, pair.vertices[1], pair.faces)
        v = np.abs(cavity_of(pair.faces, x.shape[0]).volume(np.stack([pair.vertices[0], x])))
        off = float(np.sqrt(((x - pair.vertices[1]) ** 2).sum(axis=1).mean()))
        fraction = 100 * (1 - v[1] / v[0]) - pair.ejection_fraction
        table.add(name, f"{mean:.3f}", f"{fraction:+.2f}", f"{off:.2f}", f"{seconds:.2f}")

    def ours(points: Sequence[Any], **more: Any) -> tuple[Floats, float]:
        result, seconds = timed(
            lambda: track(points, start=pair.start(), unit="mm", time="open", **more)
        )
        return result.sequence.vertices[1].astype(np.float64), seconds

    mine, own = ours(frames)
    add("ours", mine, own)
    foot, seconds = timed(
        lambda: cloud[np.linalg.norm(pair.vertices[0][:, None] - cloud, axis=2).argmin(axis=1)]
    )
    add("closest point, without a prior", foot, seconds)
    try:
        from pycpd import DeformableRegistration

        def register() -> Floats:
            found = DeformableRegistration(X=cloud, Y=pair.vertices[0], alpha=2, beta=20)
            return np.asarray(found.register()[0], dtype=np.float64)

        x, seconds = timed(register)
        add("pycpd", x, seconds)
        table.add_at_least(
            seconds / own, 20.0, "pycpd over ours, time", "", "", "", f"{seconds / own:.1f}"
        )
    except ModuleNotFoundError:
        table.add("pycpd", "not there", "", "", "")
    clean = pair.seen(N_PEER, 0.0, rng)
    mine, own = ours(clean)
    add("ours, clean points", mine, own)
    try:
        import trimesh

        def amberg() -> Floats:
            source = trimesh.Trimesh(pair.vertices[0], pair.faces, process=False)
            target = trimesh.Trimesh(pair.vertices[1], pair.faces, process=False)
            return np.asarray(trimesh.registration.nricp_amberg(source, target), dtype=np.float64)

        x, seconds = timed(amberg)
        add("trimesh nricp_amberg, the true mesh", x, seconds)
        theirs, _ = surface_distance(x, pair.faces, pair.vertices[1], pair.faces)
        table.add_at_least(
            seconds / own, 10.0, "nricp_amberg over ours, time", "", "", "", f"{seconds / own:.1f}"
        )
        full = [
            [of_surface(y, pair.faces), Observation(y[pair.faces].mean(axis=1)), *marks[1:]]
            for y, marks in zip(pair.vertices, clean, strict=True)
        ]
        mine, seconds = ours(full, tolerance=theirs)
        add("ours, the true mesh, tolerance theirs", mine, seconds)
        mean, _ = surface_distance(mine, pair.faces, pair.vertices[1], pair.faces)
        table.add_at_most(mean, theirs, "surface beside nricp_amberg's", f"{mean:.3f}", "", "", "")
    except ModuleNotFoundError:
        table.add("trimesh nricp_amberg", "not there", "", "", "")
    return table


def closed() -> Table:
    scores = [Score.of(track(t.seen(1500, 0.7, rng), unit="mm"), t) for t, rng in _closed(8)]
    means = np.array([s.mean for s in scores])
    fractions = np.abs([s.fraction for s in scores])
    table = Table(f"{len(scores)} closed surfaces, noise 0.7 mm, no landmarks", ("figure", "value"))
    table.add_at_most(float(np.median(means)), 0.3, "surface, median mm", f"{np.median(means):.3f}")
    table.add_at_most(float(means.max()), 0.6, "surface, worst mm", f"{means.max():.3f}")
    table.add_at_most(float(np.median(fractions)), 1.0, "EF, median", f"{np.median(fractions):.2f}")
    table.add_at_most(float(fractions.max()), 2.0, "EF, worst", f"{fractions.max():.2f}")
    return table


def stated(n_ventricles: int) -> Table:
    """Share of errors within the stated deviations, pooled over vertices, frames and cases."""
    across, along, names = [], [], []
    for name, truth, rng in (*_ventricles(n_ventricles), *_beyond()):
        noise = float(rng.choice([0.0, 0.5, 1.0]))
        frames = truth.seen(N_POINTS, noise, rng)
        result = track(frames, start=truth.start(), unit="mm")
        n_shares = _shares(result, truth)
        names.append(name)
        across.append(n_shares[0])
        along.append(n_shares[1])
    table = Table(f"Stated deviations, {len(names)} cases", ("", "68 %", "95 %", "worst tenth"))
    for name, cases in (("across the surface", across), ("along it", along)):
        pooled = np.concatenate(cases)
        own = np.array([(z < 1.0).mean() for z in cases])
        one, two = float((pooled < 1.0).mean()), float((pooled < 1.96).mean())
        worst = f"{np.quantile(own, 0.1):.0%} to {np.quantile(own, 0.9):.0%}"
        table.add_at_most(abs(one - 0.68), 0.08, name, f"{one:.1%}", "", worst)
        table.add_at_least(two, 0.90, name, "", f"{two:.1%}", "")
    return table


def classes(n_of_each: int) -> Table:
    """Classes that the model of offsets names for a ventricle's mesh, and for its noisy cloud."""
    model, same, right = load_model(OFFSET_MODEL), [], []
    for k, case in enumerate(
        simulate_cohort(n_of_each, rng=np.random.default_rng(1234), noise=0.0)
    ):
        if str(case.label) not in model.classes:
            continue
        mesh = replace(case.sequence, times=None)
        start = replace(mesh, vertices=mesh.vertices[:1])
        clouds = Truth.of(mesh).seen(N_POINTS, 1.0, np.random.default_rng(1234 + k))
        found = track(clouds, start=start, unit="mm").sequence
        both = [
            classify(sequence.with_facts(Facts(tracking="offset")), model).label
            for sequence in (mesh, found)
        ]
        if None not in both:
            same.append(both[0] == both[1])
            right.append([label == case.label for label in both])
    table = Table(f"Classes of {len(same)} ventricles, mesh and cloud", ("figure", "value"))
    share = float(np.mean(same))
    table.add_at_least(share, 0.97, "mesh and cloud are of the same class", f"{share:.1%}")
    of_mesh, of_cloud = np.mean(right, axis=0)
    table.add("right of meshes, of clouds", f"{of_mesh:.1%}, {of_cloud:.1%}")
    return table


def _shares(result: Track, truth: Truth) -> tuple[Floats, Floats]:
    """Errors over stated deviations, across and along the surface."""
    across, along = [], []
    for x, found, sd in zip(
        truth.vertices, result.sequence.vertices, result.deviations, strict=True
    ):
        if not sd.any():
            continue
        n = vertex_normals(found.astype(np.float64), truth.faces)
        first = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        error = found - x
        across.append(np.abs((error * n).sum(axis=1)) / sd[:, 0])
        along += [np.abs((error * t).sum(axis=1)) / sd[:, 1] for t in (first, np.cross(n, first))]
    return np.concatenate(across), np.concatenate(along)


def _ventricles(n: int) -> Iterator[tuple[str, Truth, np.random.Generator]]:
    """Simulate ventricles of all classes, every third frame."""
    cohort = simulate_cohort(-(-n // 5), rng=np.random.default_rng(2024), noise=0.0)
    for k, case in enumerate(cohort):
        if k < n:
            full = Truth.of(case.sequence)
            yield (
                str(case.label),
                Truth(full.vertices[::3], full.faces, full.ends),
                np.random.default_rng(k),
            )


def _closed(n: int) -> Iterator[tuple[Truth, np.random.Generator]]:
    """Make spheroids and bent crescents that contract unevenly."""
    base = standard_surface(Lattice(SPHERE, (40, 60)))
    for k in range(n):
        rng = np.random.default_rng(k)
        x = base.vertices[0] * np.array([25.0, 22.0, 40.0]) * rng.uniform(0.8, 1.2, 3)
        if k % 2:
            x[:, 0] += rng.uniform(0.008, 0.015) * x[:, 2] ** 2
            x[:, 1] *= 0.7
        turn, frames = rng.uniform(0, 7), []
        for phase in np.arange(16) / 16:
            c = 0.5 - 0.5 * np.cos(2 * np.pi * phase)
            s = 1 - 0.18 * c * (1 + 0.3 * np.cos(np.arctan2(x[:, 1], x[:, 0]) + turn))
            frames.append(x * np.stack([s, s, 1 - 0.1 * c + 0 * s], axis=1))
        yield Truth(np.stack(frames), base.faces, ()), rng


def _beyond() -> Iterator[tuple[str, Truth, np.random.Generator]]:
    """Make closed surfaces, and ventricles with motion that 37 modes cannot hold."""
    for truth, rng in _closed(10):
        yield "closed", truth, rng
    cohort = simulate_cohort(2, rng=np.random.default_rng(99), noise=0.0)
    for k, case in enumerate(cohort):
        rng, full = np.random.default_rng(1000 + k), Truth.of(case.sequence)
        x = full.vertices[::3]
        n = vertex_normals(x[0], full.faces)
        place = x[0][rng.integers(x.shape[1])]
        bump = np.exp(-((x[0] - place) ** 2).sum(axis=1) / 2 / 6.0**2)
        phase = np.sin(np.pi * np.arange(len(x)) / len(x))
        dented = x - 4.0 * phase[:, None, None] * bump[:, None] * n
        yield "dent", Truth(dented, full.faces, full.ends), rng


def _real(name: str) -> MeshSequence:
    return read_npz((DATA / f"{name}.npz").read_bytes()).sequence
