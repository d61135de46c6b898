"""The board behind an object dictionary: tactels, transducer, contact law and thresholds of a patch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from canopen.objectdictionary import ObjectDictionary, ODVariable

from skinbus.errors import EdsError, Fault
from skinbus.model import Cone, Law, Patch, Radial, ResidualMap, Transducer
from skinbus.model.patch import MAX_TACTELS
from skinbus.model.transducer import MOST
from skinbus.objects import cia, profile
from skinbus.objects.eds_values import BOOLEAN, TYPES, Number
from skinbus.objects.profile import Name, current, index_of, look_up, look_up_array
from skinbus.objects.residual_map import decode_map, encode_map

LAW_CONE = 0
LAW_RADIAL = 1


def describe_patch(od: ObjectDictionary, file: str = "EDS") -> Patch:
    """Return the patch that an object dictionary describes; ParameterValues win over defaults.

    Raises:
        EdsError: objects are missing, or do not make sense together; ``file`` is named in the message.
    """
    reader = _Reader(od)
    n = reader.whole(profile.TACTEL_COUNT, 1, MAX_TACTELS) or 1
    u = reader.column(profile.TACTEL_U_UM, n)
    v = reader.column(profile.TACTEL_V_UM, n)
    size = [1e-6 * reader.real(name) for name in (profile.WIDTH_UM, profile.HEIGHT_UM)]
    uv = 1e-6 * np.stack([u, v], -1)
    for k, point in enumerate(uv, 1):
        if abs(point[0]) > 0.5 * size[0] or abs(point[1]) > 0.5 * size[1]:
            reader.fault(profile.TACTEL_U_UM, f"tactel {k} at {1e3 * point} mm", "a place on the board")
    bits = reader.whole(profile.TRANSDUCER_BITS, 2, 16) or 16
    transducer = Transducer(
        full_scale=reader.real(profile.FULL_SCALE_PA), bits=reader.width_of_readings(n), converter_bits=bits
    )
    touch, release = reader.real(profile.TOUCH_PA), reader.real(profile.RELEASE_PA, zero=True)
    width = reader.own(profile.TACTEL_WIDTH, n)
    if width is not None and not (width > 0.0).all():
        reader.fault(profile.TACTEL_WIDTH, float(width.min()), "positive numbers")
        width = None
    if release > touch:
        reader.fault(profile.RELEASE_PA, release, f"at most {touch:g}, the touch threshold")
    mask = reader.whole(profile.HEALTHY_TACTELS, 0, (1 << MAX_TACTELS) - 1) or 0
    patch = Patch(
        tactels_uv=uv,
        diameter=1e-6 * reader.real(profile.TACTEL_DIAMETER_UM),
        size=(size[0], size[1]),
        transducer=transducer,
        law=reader.law(),
        threshold=touch,
        release=release,
        gain=reader.column(profile.TACTEL_GAIN, n),
        width=width,
        bias=reader.own(profile.TACTEL_BIAS_PA, n),
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
    values: dict[Name, float] = {profile.FORCE_EXPONENT: law.exponent, profile.LAW_MISFIT: law.misfit}
    if isinstance(law, Radial):
        elements = look_up_array(od, profile.RADIAL_LAW)
        if len(law.table) > len(elements):
            raise ValueError(f"the law has {len(law.table)} points, the dictionary room for {len(elements)}")
        values |= {
            profile.LAW_KIND: LAW_RADIAL,
            profile.RADIAL_STEP_UM: round(1e6 * law.step),
            profile.RADIAL_POINTS: len(law.table),
        }
    else:
        values |= {profile.LAW_KIND: LAW_CONE, profile.CONE_SLOPE: law.slope}
    found: dict[tuple[int, int], Number] = {index_of(od, name): value for name, value in values.items()}
    table = spread = np.zeros(0)
    typical = 0.0
    if isinstance(law, Radial):
        # the step is stored in whole micrometres: the table is that of the rounded step
        step, n = 1e-6 * round(1e6 * law.step), len(law.table)
        table = law.profile(step * np.arange(n))
        spread, typical = np.zeros(n), law.typical_force
        if law.misfit_profile is not None:
            spread = np.interp(step * np.arange(n), law.step * np.arange(n), law.misfit_profile)
    columns = [
        (profile.RADIAL_LAW, table),
        (profile.TACTEL_GAIN, gain),
        (profile.TACTEL_NOISE_PA, noise),
    ]
    response = (
        (profile.MISFIT_PROFILE, spread),
        (profile.TACTEL_WIDTH, width),
        (profile.TACTEL_BIAS_PA, bias),
    )
    columns += [(name, column) for name, column in response if name.object in od.names]
    if profile.RESIDUAL_MAP.object in od.names:
        found[index_of(od, profile.RESIDUAL_MAP)] = encode_map(residual_map)
    if _has(od, profile.TYPICAL_FORCE):
        found[index_of(od, profile.TYPICAL_FORCE)] = typical
    for name, column in columns:
        for variable, value in zip(
            look_up_array(od, name), np.asarray(column, np.float64).tolist(), strict=False
        ):
            found[variable.index, variable.subindex] = value
    return found


def _has(od: ObjectDictionary, name: Name) -> bool:
    try:
        look_up(od, name)
    except KeyError:
        return False
    return True


class _Reader:
    """Values by name, with a fault for each that is missing or out of range."""

    def __init__(self, od: ObjectDictionary) -> None:
        self.od = od
        self.faults: list[Fault] = []

    def fault(self, name: Name, seen: Any, wanted: str) -> None:
        self.faults.append(Fault(str(name), seen, wanted))

    def whole(self, name: Name, low: int, high: int) -> int | None:
        value = self._value(name)
        if not isinstance(value, int) or not low <= value <= high:
            self.fault(name, value, f"an integer from {low} to {high}")
            return None
        return value

    def real(self, name: Name, *, zero: bool = False) -> float:
        value = self._value(name)
        if not isinstance(value, int | float) or not 0 <= value <= MOST or (value == 0 and not zero):
            self.fault(name, value, "zero or a positive number" if zero else "a positive number")
            return 1.0
        return float(value)

    def column(self, name: Name, n: int) -> Any:
        elements = self._elements(name)
        if len(elements) < n:
            self.fault(name, f"{len(elements)} elements", f"{n}, one per tactel")
            return np.zeros(n)
        column = np.zeros(n)
        for k, element in enumerate(elements[:n]):
            value = current(element)
            if isinstance(value, int | float) and abs(value) <= MOST:  # false for NaN
                column[k] = value
            else:
                self.fault(name, f"{value!r} at sub-index {k + 1}", f"a number up to {MOST:g}")
        return column

    def noise(self, n: int) -> Any:
        """Return the noise of every tactel; where the array says 0, or is not there, that of the board."""
        board = self.real(profile.NOISE_PA, zero=True)
        if not self._elements(profile.TACTEL_NOISE_PA):
            return board
        own = self.column(profile.TACTEL_NOISE_PA, n)
        if (own < 0.0).any():
            self.fault(profile.TACTEL_NOISE_PA, float(own.min()), "zero or positive numbers")
        return np.where(own > 0.0, own, board)

    def own(self, name: Name, n: int) -> Any:
        """Return a column that boards of others need not have; None where they have none."""
        return self.column(name, n) if self._elements(name) else None

    def optional(self, name: Name) -> float:
        """Return a number that boards of others need not have, 0 for those."""
        return self.own_number(name) or 0.0

    def own_number(self, name: Name) -> float | None:
        """Return zero or a positive number; None where the board, of another make, has no such object."""
        return self.real(name, zero=True) if _has(self.od, name) else None

    def residual_map(self, n: int) -> ResidualMap | None:
        data = self._value(profile.RESIDUAL_MAP)
        if not isinstance(data, bytes | bytearray):
            return None
        try:
            return decode_map(bytes(data), n)
        except ValueError as error:
            self.fault(profile.RESIDUAL_MAP, str(error), f"a map of {n} tactels, or nothing")
            return None

    def law(self) -> Law:
        kind = self.whole(profile.LAW_KIND, LAW_CONE, LAW_RADIAL)
        exponent, misfit = self.real(profile.FORCE_EXPONENT), self.optional(profile.LAW_MISFIT)
        if kind != LAW_RADIAL:
            return Cone(self.real(profile.CONE_SLOPE), exponent, misfit)
        length = len(self._elements(profile.RADIAL_LAW))
        points = self.whole(profile.RADIAL_POINTS, 2, max(2, length)) or 2
        table = self.column(profile.RADIAL_LAW, points)
        if not table[0] > 0.0:
            self.fault(profile.RADIAL_LAW, f"{table[0]:g} at sub-index 1", "a positive number: the peak")
            return Cone()
        spread = self.own(profile.MISFIT_PROFILE, points)
        if spread is not None and (spread < 0.0).any():
            self.fault(profile.MISFIT_PROFILE, float(spread.min()), "zero or positive numbers")
            spread = None
        return Radial(
            1e-6 * self.real(profile.RADIAL_STEP_UM),
            table,
            exponent,
            misfit,
            spread if spread is not None and spread.any() else None,
            self.optional(profile.TYPICAL_FORCE),
        )

    def width_of_readings(self, n: int) -> int:
        """Return the bits of a reading: those of its object, in which CiA 401 adjusts it to the left."""
        found = [index for index in cia.READINGS if index in self.od.indices]
        if not found:
            wanted = ", ".join(f"0x{index:04X}" for index in cia.READINGS)
            self.faults.append(Fault("readings", None, f"an array of analogue inputs: {wanted}"))
            return 16
        last = self.od.get_variable(found[0], n)
        if last is None:
            self.faults.append(Fault(f"0x{found[0]:04X}", f"no sub-index {n}", f"{n} readings"))
            return 16
        kind = TYPES[last.data_type or BOOLEAN]
        if not (kind.low < 0 and 8 <= kind.bits <= 32):
            self.faults.append(Fault(f"0x{found[0]:04X}", kind.name, "readings of INTEGER8 to INTEGER32"))
            return 16
        return kind.bits

    def _value(self, name: Name) -> int | float | str | bytes | None:
        try:
            return current(look_up(self.od, name))
        except KeyError:
            return None

    def _elements(self, name: Name) -> Sequence[ODVariable]:
        try:
            return look_up_array(self.od, name)
        except KeyError:
            return ()
