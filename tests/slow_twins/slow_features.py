"""Features about an axis one by one, as their definition says: each reading on its own."""

from __future__ import annotations

import cmath

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import AxisReading
from modalmotion.modes import ModeSet
from modalmotion.signature.making import ModalSignature

Array = NDArray[np.float64]


def harmonic(signal: Array, angle: Array, count: int, h: int) -> complex:
    """Give c_h of signal = mean + sum Re(c_h exp(-i h angle)), all up to `count` fitted at once."""
    found = min(count, max(1, (len(angle) - 1) // 2))
    if h > found:
        return 0j
    waves = [np.ones(len(angle))]
    waves += [np.cos(k * angle) for k in range(1, found + 1)]
    waves += [np.sin(k * angle) for k in range(1, found + 1)]
    solution = np.linalg.lstsq(np.stack(waves, axis=1), signal, rcond=1e-8)[0]
    return complex(solution[h], solution[found + h])


def slow_axis_features(
    signature: ModalSignature, reading: AxisReading, n_signed: int, n_sized: int, *, walls: bool
) -> dict[str, float]:
    """Features by name of one reading."""
    a = 100.0 * signature.amplitudes / np.sqrt(np.prod(signature.lengths))
    a = a - a.mean(axis=0)
    n = len(a)
    assert isinstance(signature.modes, ModeSet)
    assert signature.landmarks is not None
    times = np.arange(n, dtype=float) if signature.times is None else signature.times
    angle = 2 * np.pi * (times - times[0]) / (times[-1] - times[0]) * (n - 1) / n
    modes = {
        (p, q, bool(sine)): a[:, k]
        for k, ((p, q), sine) in enumerate(
            zip(signature.modes.wavenumbers.tolist(), signature.modes.is_sine, strict=True)
        )
    }
    hand = -1.0 if reading.is_mirrored else 1.0
    pairs = {
        (q, p): (modes[p, q, False], hand * modes[p, q, True])
        for p, q, sine in modes
        if q > 0 and sine
    }
    flat = {p: modes[p, 0, False] for p, q, _ in modes if q == 0 and p > 0}
    rings = sorted(p for q, p in pairs if q == 1)
    turning = sum(np.cross(*pairs[1, p]).sum(axis=0) for p in rings)
    e3 = turning / np.linalg.norm(turning)
    if walls:
        e1 = signature.landmarks.theta_zero - (signature.landmarks.theta_zero @ e3) * e3
    else:
        start = np.eye(3)[np.argmin(np.abs(e3))]
        e1 = np.cross(start, e3)
    e1 = e1 / np.linalg.norm(e1)
    e2 = np.cross(e3, e1)

    def w(v: Array) -> NDArray[np.complex128]:
        across: NDArray[np.complex128] = v @ e1 + 1j * (v @ e2)
        return across

    level = {p: (w(pairs[1, p][0]) - 1j * w(pairs[1, p][1])) / 2 for p in rings}
    gauge = np.exp(-0.5j * np.angle((level[rings[0]] ** 2).sum()))
    if (level[rings[0]] * gauge).real @ (flat[min(flat)] @ e3) > 0:
        gauge = -gauge
    inward = -1.0 if reading.is_inverted else 1.0
    signed = {f"radial {p}": inward * (level[p] * gauge).real for p in rings}
    signed |= {f"turning {p}": inward * (level[p] * gauge).imag for p in rings}
    signed |= {f"axial {p}": flat[p] @ e3 for p in sorted(flat)}
    sized = {f"across {p}": w(flat[p]) for p in flat}
    for (q, p), (c, s) in pairs.items():
        oval, tilt = (w(c) + 1j * w(s)) / 2, c @ e3 - 1j * (s @ e3)
        sized[f"oval {p}" if q == 1 else f"lobe ({p}, {q})"] = oval
        sized[f"tilt {p}" if q == 1 else f"wave ({p}, {q})"] = tilt
        if q > 1:
            sized[f"side ({p}, {q})"] = (w(c) - 1j * w(s)) / 2
    most = max(n_signed, n_sized)
    clock = cmath.phase(-harmonic(signed[f"radial {rings[0]}"], angle, most, 1))

    def terms(signal: Array, h: int) -> complex:
        return harmonic(signal, angle, most, h) * cmath.exp(-1j * h * clock)

    found: dict[str, float] = {}
    for name, signal in signed.items():
        for h in range(1, n_signed + 1):
            z = terms(signal, h)
            found |= {f"{name} cos {h}": z.real, f"{name} sin {h}": z.imag}
    for name, path in sized.items():
        for h in range(1, n_sized + 1):
            x, y = terms(path.real, h), terms(path.imag, h)
            if walls:
                found |= {f"{name} towards zero cos {h}": x.real}
                found |= {f"{name} towards zero sin {h}": x.imag}
                found |= {f"{name} across zero cos {h}": y.real}
                found |= {f"{name} across zero sin {h}": y.imag}
            else:
                found[f"{name} cos {h}"] = np.sqrt(np.hypot(x.real, y.real))
                found[f"{name} sin {h}"] = np.sqrt(np.hypot(x.imag, y.imag))
    del found[f"radial {rings[0]} sin 1"]
    return found
