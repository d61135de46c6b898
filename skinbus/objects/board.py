"""The board behind an object dictionary: tactels, transducer, contact law and thresholds of a patch."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary, ODVariable

from skinbus.errors import EdsError, FaultList
from skinbus.model import Cone, Law, Patch, Radial, ResidualMap, Transducer
from skinbus.model.law import DEFAULT_LAW
from skinbus.model.limits import MOST
from skinbus.model.patch import MAX_TACTELS
from skinbus.objects import cia, profile
from skinbus.objects.eds_values import BOOLEAN, TYPES, Number
from skinbus.objects.profile import current, has, index_of, look_up, look_up_array

LAW_CONE = 0
LAW_RADIAL = 1

_OPTIONAL = (
    profile.TACTEL_WIDTH,
    profile.TACTEL_BIAS_PA,
    profile.RESIDUAL_MAP,
    profile.MISFIT_PROFILE,
    profile.TYPICAL_FORCE,
)
"""What boards of others need not have."""

_MAP_HEADER = struct.Struct("<BBHf")
"""Tactels, points along an axis, step in um, 1/m^2 of one count."""


def describe_patch(od: ObjectDictionary, file: str = "EDS") -> Patch:
    """Return the patch that an object dictionary describes; ParameterValues win over defaults.

    Raises:
        EdsError: objects are missing, or do not make sense together; ``file`` is named in the message.
    """
    reader = _Reader(od)
    n = reader.whole(profile.TACTEL_COUNT, 1, MAX_TACTELS)
    uv = 1e-6 * np.stack([reader.column(name, n) for name in (profile.TACTEL_U_UM, profile.TACTEL_V_UM)], -1)
    size = 1e-6 * reader.real(profile.WIDTH_UM), 1e-6 * reader.real(profile.HEIGHT_UM)
    for k in np.flatnonzero((abs(uv) > 0.5 * np.array(size)).any(axis=1)):
        reader.fault(profile.TACTEL_U_UM, f"tactel {k + 1} at {1e3 * uv[k]} mm", "a place on the board")
    touch, release = reader.real(profile.TOUCH_PA), reader.real(profile.RELEASE_PA, zero=True)
    if release > touch:
        reader.fault(profile.RELEASE_PA, release, f"at most {touch:g}, the touch threshold")
    mask = reader.whole(profile.HEALTHY_TACTELS, 0, (1 << MAX_TACTELS) - 1)
    patch = Patch(
        tactels_uv=uv,
        diameter=1e-6 * reader.real(profile.TACTEL_DIAMETER_UM),
        size=size,
        transducer=Transducer(
            full_scale=reader.real(profile.FULL_SCALE_PA),
            bits=reader.width_of_readings(n),
            converter_bits=reader.whole(profile.TRANSDUCER_BITS, 2, 16),
        ),
        law=reader.law(),
        threshold=touch,
        release=release,
        gain=reader.column(profile.TACTEL_GAIN, n),
        width=reader.own(profile.TACTEL_WIDTH, n, 1.0, "positive numbers", 1e-6),
        bias=reader.own(profile.TACTEL_BIAS_PA, n, 0.0),
        residual_map=reader.residual_map(n),
        offset=reader.column(profile.TACTEL_OFFSET, n),
        noise=reader.noise(n),
        zero_band=reader.own_number(profile.ZERO_BAND_PA),
        zero_drift=reader.own_number(profile.ZERO_DRIFT_PA),
        healthy=np.array([mask >> k & 1 for k in range(n)], np.bool_),
    )
    if reader.faults:
        raise EdsError(file, reader.faults)
    return patch


def calibration_values(
    od: ObjectDictionary,
    *,
    law: Law,
    gain: npt.ArrayLike,
    noise: npt.ArrayLike,
    width: npt.ArrayLike = (),
    bias: npt.ArrayLike = (),
    residual_map: ResidualMap | None = None,
) -> dict[tuple[int, int], Number]:
    """Return the objects that hold a calibration, by index and sub-index: what :func:`describe_patch` reads.

    gain, noise, width, bias: (n_tactels,) factor, Pa, factor, Pa, of this patch's tactels. Objects of a
    response (width, bias, map, misfit profile) that a dictionary does not have are left out.

    Raises:
        KeyError: the dictionary has no such object.
        ValueError: the law's table does not fit the dictionary's.
    """
    values: dict[str, Any] = {
        profile.FORCE_EXPONENT: law.exponent,
        profile.LAW_MISFIT: law.misfit,
        profile.TYPICAL_FORCE: 0.0,
        profile.TACTEL_GAIN: gain,
        profile.TACTEL_NOISE_PA: noise,
        profile.TACTEL_WIDTH: width,
        profile.TACTEL_BIAS_PA: bias,
        profile.RESIDUAL_MAP: encode_map(residual_map),
    }
    if isinstance(law, Radial):
        n, room = len(law.table), len(look_up_array(od, profile.RADIAL_LAW))
        if n > room:
            raise ValueError(f"the law has {n} points, the dictionary room for {room}")
        step_um = round(1e6 * law.step)
        d = 1e-6 * step_um * np.arange(n)  # the table is that of the rounded step
        spread = np.zeros(n) if law.misfit_profile is None else law.misfit_profile
        values |= {profile.LAW_KIND: LAW_RADIAL, profile.RADIAL_STEP_UM: step_um, profile.RADIAL_POINTS: n}
        values |= {profile.RADIAL_LAW: law.profile(d), profile.TYPICAL_FORCE: law.typical_force}
        values[profile.MISFIT_PROFILE] = np.interp(d, law.step * np.arange(n), spread)
    else:
        values |= {profile.LAW_KIND: LAW_CONE, profile.CONE_SLOPE: law.slope}
    found: dict[tuple[int, int], Number] = {}
    for name, value in values.items():
        if name in _OPTIONAL and not has(od, name):
            continue
        if isinstance(value, int | float | bytes):
            found[index_of(od, name)] = value
        else:
            column = np.asarray(value, np.float64).tolist()
            for variable, number in zip(look_up_array(od, name), column, strict=False):
                found[variable.index, variable.subindex] = number
    return found


def encode_map(found: ResidualMap | None) -> bytes:
    """Return a residual map as the bytes of its object: a header, then a signed byte for each point.

    A byte resolves 1/127 of the largest value: of 3 % of a peak that is 0.02 %, a tenth of what a map leaves.
    """
    if found is None:
        return b""
    values = np.asarray(found.values, np.float64)
    scale = float(np.abs(values).max()) / 127.0 or 1.0
    header = _MAP_HEADER.pack(values.shape[0], values.shape[1], round(1e6 * found.step), scale)
    return header + np.rint(values / scale).astype(np.int8).tobytes()


def decode_map(data: bytes, n_tactels: int) -> ResidualMap | None:
    """Return the map that bytes hold, None of none.

    Raises:
        ValueError: the bytes are no map of so many tactels.
    """
    if not data:
        return None
    if len(data) < _MAP_HEADER.size:
        raise ValueError(f"{len(data)} bytes are no residual map")
    n, points, step, scale = _MAP_HEADER.unpack_from(data)
    if n != n_tactels or len(data) != _MAP_HEADER.size + n * points * points:
        raise ValueError(f"{len(data)} bytes of {n} tactels are no residual map of {n_tactels}")
    counts = np.frombuffer(data, np.int8, offset=_MAP_HEADER.size).reshape(n, points, points)
    return ResidualMap(1e-6 * step, scale * counts.astype(np.float64))


class _Reader:
    """Values by name, with a fault for each that is missing or out of range."""

    def __init__(self, od: ObjectDictionary) -> None:
        self.od = od
        self.faults = FaultList()
        self.fault = self.faults.add

    def whole(self, name: str, low: int, high: int) -> int:
        value = self._value(name)
        if isinstance(value, int) and low <= value <= high:
            return value
        self.fault(name, value, f"an integer from {low} to {high}")
        return high

    def real(self, name: str, *, zero: bool = False) -> float:
        value = self._value(name)
        if not isinstance(value, int | float) or not 0 <= value <= MOST or (value == 0 and not zero):
            self.fault(name, value, "zero or a positive number" if zero else "a positive number")
            return 1.0
        return float(value)

    def column(self, name: str, n: int) -> Any:
        elements = self._elements(name)
        if len(elements) < n:
            self.fault(name, f"{len(elements)} elements", f"{n}, one per tactel")
        column = np.zeros(n)
        for k, element in enumerate(elements[:n]):
            value = current(element)
            if isinstance(value, int | float) and abs(value) <= MOST:  # false for NaN
                column[k] = value
            else:
                self.fault(name, f"{value!r} at sub-index {k + 1}", f"a number up to {MOST:g}")
        return column

    def own(self, name: str, n: int, usual: Any, wanted: str = "", least: float = -MOST) -> Any:
        """Return a column that boards of others need not have; the usual without one, or after a fault."""
        if not self._elements(name):
            return usual
        column = self.column(name, n)
        if column.min() < least:
            self.fault(name, float(column.min()), wanted)
            return usual
        return column

    def noise(self, n: int) -> Any:
        """Return the noise of every tactel; where the array says 0, or is not there, that of the board."""
        board = self.real(profile.NOISE_PA, zero=True)
        own = self.own(profile.TACTEL_NOISE_PA, n, np.zeros(n), "zero or positive numbers", 0.0)
        return np.where(own > 0.0, own, board)

    def own_number(self, name: str) -> float | None:
        """Return zero or a positive number; None where the board, of another make, has no such object."""
        return self.real(name, zero=True) if has(self.od, name) else None

    def residual_map(self, n: int) -> ResidualMap | None:
        data = self._value(profile.RESIDUAL_MAP)
        try:
            return decode_map(data, n) if isinstance(data, bytes) else None
        except ValueError as error:
            self.fault(profile.RESIDUAL_MAP, str(error), f"a map of {n} tactels, or nothing")
            return None

    def law(self) -> Law:
        try:
            return self._law()
        except ValueError as error:
            self.fault(profile.LAW_KIND, None, f"a law within its limits: {error}")
            return DEFAULT_LAW

    def _law(self) -> Law:
        kind = self.whole(profile.LAW_KIND, LAW_CONE, LAW_RADIAL)
        exponent, misfit = self.real(profile.FORCE_EXPONENT), self.own_number(profile.LAW_MISFIT) or 0.0
        if kind != LAW_RADIAL:
            return Cone(self.real(profile.CONE_SLOPE), exponent, misfit)
        points = self.whole(profile.RADIAL_POINTS, 2, max(2, len(self._elements(profile.RADIAL_LAW))))
        table = self.column(profile.RADIAL_LAW, points)
        if not table[0] > 0.0:
            self.fault(profile.RADIAL_LAW, f"{table[0]:g} at sub-index 1", "a positive number: the peak")
            return DEFAULT_LAW
        spread = self.own(profile.MISFIT_PROFILE, points, np.zeros(1), "zero or positive numbers", 0.0)
        return Radial(
            1e-6 * self.real(profile.RADIAL_STEP_UM),
            table,
            exponent,
            misfit,
            spread if spread.any() else None,
            self.own_number(profile.TYPICAL_FORCE) or 0.0,
        )

    def width_of_readings(self, n: int) -> int:
        """Return the bits of a reading: those of its object, in which CiA 401 adjusts it to the left."""
        found = [index for index in cia.READINGS if index in self.od.indices]
        if not found:
            wanted = ", ".join(f"0x{index:04X}" for index in cia.READINGS)
            self.faults.add("readings", None, f"an array of analogue inputs: {wanted}")
            return 16
        last = self.od.get_variable(found[0], n)
        if last is None:
            self.faults.add(f"0x{found[0]:04X}", f"no sub-index {n}", f"{n} readings")
            return 16
        kind = TYPES[last.data_type or BOOLEAN]
        if not (kind.low < 0 and 8 <= kind.bits <= 32):
            self.faults.add(f"0x{found[0]:04X}", kind.name, "readings of INTEGER8 to INTEGER32")
            return 16
        return kind.bits

    def _value(self, name: str) -> int | float | str | bytes | None:
        try:
            return current(look_up(self.od, name))
        except KeyError:
            return None

    def _elements(self, name: str) -> Sequence[ODVariable]:
        try:
            return look_up_array(self.od, name)
        except KeyError:
            return ()
