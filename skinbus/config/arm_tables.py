"""The tables of an arm file, as pydantic models: which keys there are, and what a value may be."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo

from skinbus.model.arm import BusSettings
from skinbus.model.surface import Surface

MAX_SETTINGS = 100
"""Of one patch: more than its EDS has objects to set."""

MAX_NAME = 100
"""Characters of a name: a line of a terminal, and less than a message of CANopen."""

MAX_PATCH_ID = 126
"""Of a patch; 127 is the master's."""


def _check_setting(value: Any) -> Any:
    items = value if isinstance(value, list) and value else [value]
    if not all(isinstance(item, bool | int | float | str) for item in items):
        raise ValueError("a number, a text, true or false, or a list of them")
    return value


def _check_text(value: str) -> str:
    if not value.isprintable():
        raise ValueError("text without control characters")
    return value


def _check_node_id(value: int) -> int:
    if value > MAX_PATCH_ID:
        raise ValueError(f"a node-ID from 1 to {MAX_PATCH_ID}; 127 is that of the master")
    return value


def _check_counter(value: int) -> int:
    if value == 1:
        raise ValueError("0, or 2 to 240 (CiA 301, 7.5.2.22)")
    return value


def _check_cone(length: float, info: ValidationInfo) -> float:
    near, far = (info.data.get(f"radius_{end}_mm", 0.0) for end in ("near", "far"))
    if abs(far - near) >= length or abs((1e-3 * far - 1e-3 * near) / (1e-3 * length)) >= 1.0:
        raise ValueError(f"more than {abs(far - near):g}, the change of radius")
    return length


Setting = Annotated[Any, AfterValidator(_check_setting)]
Timeout = Annotated[int, Field(ge=10, le=60_000)]
"""ms: longer than any frame waits on a bus that works, shorter than anybody waits for a robot."""
Positive = Annotated[float, Field(gt=0.0, le=1e9)]
Length = Annotated[float, Field(ge=1.0, le=1e5)]
"""mm: from less than a tactel to more than a crane."""
Place = Annotated[float, Field(ge=-1e6, le=1e6)]
"""mm or degrees: beyond them a double has less than nanometres left."""
Text = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_check_text)]
Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME), AfterValidator(_check_text)]
Bitrate = Literal[125_000, 250_000, 500_000, 800_000, 1_000_000]
DataBitrate = Literal[1_000_000, 2_000_000, 4_000_000, 5_000_000, 8_000_000]
"""Those that CiA 601-3 recommends for the data phase of CAN FD."""
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Point = Annotated[list[Place], Field(min_length=3, max_length=3)]
NodeId = Annotated[int, Field(ge=1), AfterValidator(_check_node_id)]


def beside(name: str, arm_file: Path) -> Path:
    """Return a file that an arm file names: as seen from its folder, or an absolute path as it is."""
    return arm_file.parent / name


def eds_beside(name: str, arm_file: Path) -> str:
    """Return the name of an EDS that ships as it is, and a path as seen from the folder of the arm file."""
    return str(beside(name, arm_file)) if is_path(name) else name


def is_path(eds: str) -> bool:
    """Whether this is the path of an EDS or DCF file, not the name of one that ships."""
    return Path(eds).suffix != "" or Path(eds).name != eds


class Table(BaseModel):
    """A table: no unknown keys, no conversions."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class ArmTable(Table):
    """``[arm]``: the arm, and what all its buses have in common."""

    name: Name
    bitrate: Bitrate = 1_000_000
    canfd: bool = False
    """Whether frames of more than 8 bytes may be on the bus."""
    data_bitrate: DataBitrate | None = None
    rate_hz: Annotated[float, Field(ge=1.0, le=1000.0)] = 50.0
    """Cycles a second; one at least: each is a sign of life, for which the service manager waits two."""
    sync_counter: Annotated[int, Field(ge=0, le=240), AfterValidator(_check_counter)] = 0
    """0x1019 of the master and all patches; 0, the default of CiA 301: SYNC carries no counter."""
    max_age_ms: Annotated[int, Field(ge=1, le=5000)] = BusSettings().max_age_ms
    """Oldest sample that is used; 0x2070:03 counts to 6.5 s."""
    sdo_timeout_ms: Timeout = BusSettings().sdo_timeout_ms
    store_timeout_ms: Timeout = BusSettings().store_timeout_ms


class BusTable(Table):
    """``[[bus]]``: a bus of the arm, and the interface it is on unless the user says otherwise."""

    name: Annotated[str, Field(max_length=MAX_NAME, pattern=r"^[A-Za-z0-9_.-]+$")]
    bitrate: Bitrate | None = None
    canfd: bool | None = None
    data_bitrate: DataBitrate | None = None
    interface: Text | None = None
    channel: Text | None = None


class LinkTable(Table):
    """``[[link]]``: a rigid part with one surface; each kind of surface has its own sizes."""

    name: Name
    surface: str
    frame: Name | None = None
    """Link of the URDF that it is a part of; None for that of its own name."""
    xyz_mm: Triple = [0.0, 0.0, 0.0]
    rpy_deg: Triple = [0.0, 0.0, 0.0]
    """Pose of the surface in that link, as the origin of an element of a URDF."""
    kind: ClassVar[str]
    places: ClassVar[tuple[str, ...]] = ("s_mm", "angle_deg", "yaw_deg")
    """Keys that place a board on it."""

    def build(self) -> Surface:
        """Return the surface of a link that is no mesh."""
        raise NotImplementedError

    def across(self, patch: PatchTable) -> float:
        """Return where a patch is across it or around it, m on its chart; 0 on a mesh."""
        if "angle_deg" not in self.places:
            return 1e-3 * (patch.a_mm or 0.0)
        surface = self.build()
        return float(surface.wrap(math.radians(patch.angle_deg or 0.0) * surface.radius))


class PlaneTable(LinkTable):
    """A plane."""

    kind = "plane"
    length_mm: Length
    width_mm: Length
    places = ("s_mm", "a_mm", "yaw_deg")

    def build(self) -> Surface:
        """Return the surface."""
        return Surface.plane(1e-3 * self.length_mm, 1e-3 * self.width_mm)


class CylinderTable(LinkTable):
    """A cylinder."""

    kind = "cylinder"
    length_mm: Length
    radius_mm: Length

    def build(self) -> Surface:
        """Return the surface."""
        return Surface.cylinder(1e-3 * self.length_mm, 1e-3 * self.radius_mm)


class ConeTable(LinkTable):
    """A cone frustum; its length is measured along the surface, and more than its radius changes."""

    kind = "cone"
    radius_near_mm: Length
    radius_far_mm: Length
    length_mm: Annotated[Length, AfterValidator(_check_cone)]

    def build(self) -> Surface:
        """Return the surface."""
        near, far = 1e-3 * self.radius_near_mm, 1e-3 * self.radius_far_mm
        return Surface.cone(1e-3 * self.length_mm, near, far)


class MeshTable(LinkTable):
    """A mesh."""

    kind = "mesh"
    mesh: Text
    """File of a mesh: STL, OBJ or PLY, in the frame of the surface."""
    unit_mm: Annotated[float, Field(gt=0.0, le=1e6)] = 1.0
    """Length of the unit of that file."""
    places = ("xyz_mm", "along")


SURFACES = {kind.kind: kind for kind in (PlaneTable, CylinderTable, ConeTable, MeshTable)}


class Mounted(Table):
    """What a patch and a ring of patches share."""

    link: Name
    s_mm: Place
    yaw_deg: Place = 0.0
    mirrored: bool = False
    """Whether v runs the other way: the tactels are wired, or the board is mounted, as in a mirror."""
    bus: Name | None = None
    set: Annotated[dict[Name, Setting], Field(max_length=MAX_SETTINGS)] = {}


class PatchTable(Mounted):
    """``[[patch]]``: one patch; on a plane ``a_mm`` places it across, elsewhere ``angle_deg`` around.

    On a mesh it is laid at ``xyz_mm`` with u along ``along``.
    """

    node_id: NodeId
    eds: Text = "skin-patch"
    s_mm: Place | None = None  # type: ignore[assignment]  # narrower than that of a ring
    xyz_mm: Point | None = None
    along: Point | None = None
    angle_deg: Place | None = None
    a_mm: Place | None = None
    serial: Annotated[int, Field(ge=0, lt=1 << 32)] = 0
    address: Annotated[str, Field(max_length=20, pattern=r"^[0-9.]*$")] | None = None
    """Of its readings among those of a skin that is not CANopen, see ``skinbus gateway``."""


class RingTable(Mounted):
    """``[[ring]]``: ``count`` patches evenly around a link, node-IDs counting up from the first."""

    count: Annotated[int, Field(ge=1, le=MAX_PATCH_ID)]
    first_node_id: NodeId
    eds: Text | Annotated[list[Text], Field(min_length=1, max_length=MAX_PATCH_ID)] = "skin-patch"
    """Of all boards, or one for each: DCF files of boards that were calibrated one by one."""
    angle_deg: Place = 0.0

    def boards(self) -> list[PatchTable]:
        """Return its patches one by one."""
        files = self.eds if isinstance(self.eds, list) else [self.eds] * self.count
        shared = self.model_dump(include={*Mounted.model_fields}, exclude_unset=True)
        return [
            PatchTable.model_construct(
                node_id=self.first_node_id + k,
                eds=eds,
                angle_deg=self.angle_deg + 360.0 * k / self.count,
                **shared,
            )
            for k, eds in enumerate(files)
        ]
