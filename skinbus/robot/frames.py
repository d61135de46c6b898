"""Contacts in the frames of the robot, and the torques and wrenches that they make: the checked door."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from skinbus.model import Arm
from skinbus.model.mesh_surface import compile_grids
from skinbus.robot.chain import Chain, load_chain
from skinbus.robot.kernels import place

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

FRAMES: Final = ("link", "base", "tool")
"""Frames of the output, in the order of its arrays."""


class ContactColumns(Protocol):
    """The columns that are placed: those of the estimator's contacts."""

    @property
    def link(self) -> Ints:
        """(n,) link."""

    @property
    def s(self) -> Floats:
        """(n,) m."""

    @property
    def a(self) -> Floats:
        """(n,) m."""

    @property
    def force(self) -> Floats:
        """(n,) N."""

    @property
    def covariance(self) -> Floats:
        """(n, 3, 3) of s, a (m), force (N)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotContacts:
    """The contacts of one cycle on the robot; frames are those of :data:`FRAMES`.

    A contact pushes with ``-force * normal``: tactels measure no shear.

    valid              whether the joint positions were young enough; if not, all is NaN but in frame "link"
    positions          (n_joints,) rad or m, at the time of the cycle
    positions_sd       (n_joints,) standard deviations
    point, normal      (n, 3 frames, 3) m; outward unit normals
    covariance         (n, 3 frames, 3, 3) m^2, of the point: by that of s and a, and by the joints; NaN of a
                       contact without one, as the torques have none then
    force              (n,) N, along the normal, and its variance force_variance (n,) N^2
    jacobian           (n, 6, n_joints) of the point in the base: velocity, then angular velocity
    torques            (n_joints,) N m or N, of all contacts on the joints; what drives hold is its negative
    torque_covariance  (n_joints, n_joints); contacts are taken as independent of each other
    base_wrench        (6,) force (N) and moment (N m) of all contacts about the base, in the base frame
    link_wrench        (n_links, 6) of the contacts of each link, about the frame of its URDF link, in it
    """

    valid: bool
    positions: Floats
    positions_sd: Floats
    point: Floats
    normal: Floats
    covariance: Floats
    force: Floats
    force_variance: Floats
    jacobian: Floats
    torques: Floats
    torque_covariance: Floats
    base_wrench: Floats
    link_wrench: Floats

    def force_vector(self, frame: str = "base") -> Floats:
        """Return the force of each contact on the skin in a frame, (n, 3) N."""
        return -self.force[:, None] * self.normal[:, FRAMES.index(frame)]


class RobotFrames:
    """Places the contacts of an arm, with arrays and kernels made once.

    Raises:
        ConfigError: faults of the URDF, or of the arm file that goes with it.
        SkinbusError: yourdfpy is not installed.
        ValueError: the arm has no robot.
    """

    def __init__(self, arm: Arm, chain: Chain | None = None) -> None:
        self.arm = arm
        self.chain = chain = load_chain(arm) if chain is None else chain
        self._joints = (chain.parent, chain.linear, chain.R_PJ, chain.p_PJ, chain.axis)
        self._frames = (chain.carrier, chain.R_CF, chain.p_CF, chain.moves)
        n, n_frames = chain.n_joints, len(chain.carrier)
        self._n_links = len(arm.links)
        self._unknown = np.zeros(n), np.zeros(n)
        links = (arm.link_radius, arm.link_taper, arm.link_period, arm.link_length)
        self._room = (
            np.zeros((n, 3, 3)),
            np.zeros((n, 3)),
            np.zeros((n, 3)),
            np.zeros((n_frames, 3, 3)),
            np.zeros((n_frames, 3)),
            np.ascontiguousarray(np.stack(links, -1)),
            *compile_grids(link.surface for link in arm.links),
            np.zeros((6, 3)),
            np.zeros((6, 3)),
            np.zeros((2, 3, 3)),
            np.zeros((2 * n, max(n, 3))),
        )
        self.nothing = self.place(_NoContacts(), *self._unknown)  # compiled now, not in a cycle
        """No contacts, at positions 0."""

    def place(
        self,
        contacts: ContactColumns,
        positions: Floats | None,
        sd: Floats | None = None,
        *,
        checked: bool = False,
    ) -> RobotContacts:
        """Return contacts on the robot.

        positions: (n_joints,) rad or m, finite; None where they are not known.
        sd:        (n_joints,) their standard deviations; None for zeros.
        checked:   positions are known to be finite and of the right shape.

        Raises:
            ValueError: positions of another number of joints, or that are not finite.
        """
        n, n_joints = len(contacts.s), self.chain.n_joints
        valid = positions is not None
        q = self._unknown[0] if positions is None else np.ascontiguousarray(positions, np.float64)
        deviation = self._unknown[1] if sd is None else np.ascontiguousarray(sd, np.float64)
        if q.shape != (n_joints,) or deviation.shape != (n_joints,):
            raise ValueError(f"positions of shape {q.shape}; wanted ({n_joints},), one for each moving joint")
        if not checked and not (np.isfinite(q).all() and np.isfinite(deviation).all()):
            raise ValueError("positions and their deviations must be finite")
        point, normal = np.empty((n, 3, 3)), np.empty((n, 3, 3))
        covariance, jacobian = np.empty((n, 3, 3, 3)), np.empty((n, 6, n_joints))
        torques, torque_covariance = np.empty(n_joints), np.empty((n_joints, n_joints))
        base_wrench, link_wrench = np.empty(6), np.empty((self._n_links, 6))
        place(
            q,
            deviation * deviation,
            *self._joints,
            *self._frames,
            *self._room,
            contacts.link,
            contacts.s,
            contacts.a,
            contacts.force,
            contacts.covariance,
            point,
            normal,
            covariance,
            jacobian,
            torques,
            torque_covariance,
            base_wrench,
            link_wrench,
        )
        is_unknown = contacts.covariance[:, 2, 2] <= 0.0  # at level kmeans
        if is_unknown.any():
            covariance[is_unknown] = torque_covariance[:] = np.nan
        if not valid:
            for array in (point[:, 1:], normal[:, 1:], covariance[:, 1:], jacobian, torques):
                array[...] = np.nan
            torque_covariance[:] = base_wrench[:] = np.nan
        return RobotContacts(
            valid=valid,
            positions=q.copy() if valid else np.full(n_joints, np.nan),
            positions_sd=deviation.copy() if valid else np.full(n_joints, np.nan),
            point=point,
            normal=normal,
            covariance=covariance,
            force=contacts.force,
            force_variance=contacts.covariance[:, 2, 2],
            jacobian=jacobian,
            torques=torques,
            torque_covariance=torque_covariance,
            base_wrench=base_wrench,
            link_wrench=link_wrench,
        )

    def surface_pose(self, link: int, positions: Floats) -> tuple[Floats, Floats]:
        """Return rotation (3, 3) and origin (3,) m of the surface of a link in the base."""
        self.place(_NoContacts(), positions)
        return self._room[3][link].copy(), self._room[4][link].copy()

    def pose(self, frame: str) -> tuple[Floats, Floats]:
        """Return rotation (3, 3) and origin (3,) m of "tool" or a link in the base, as last placed."""
        names = [link.name for link in self.arm.links]
        row = 2 * self._n_links if frame == "tool" else self._n_links + names.index(frame)
        return self._room[3][row].copy(), self._room[4][row].copy()


class _NoContacts:
    """No contacts: what kernels are compiled with."""

    link: Ints = np.zeros(0, np.int64)
    s = a = force = np.zeros(0)
    covariance = np.zeros((0, 3, 3))
