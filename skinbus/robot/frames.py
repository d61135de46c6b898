"""Contacts in the frames of the robot, and the torques and wrenches that they make: the checked door.

A contact of force F at point p with outward normal n pushes with f = -F n. A joint that turns about z
through o moves p by v = z x (p - o), one that slides by v = z; its torque, or force, is v . f.

Derivatives by the place on a surface are central differences; all others are exact.
Source: K. Lynch, F. Park, Modern Robotics (2017), 5.1 (geometric Jacobian), 5.2 (statics).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from skinbus.arrays import Floats, Ints
from skinbus.model import Arm
from skinbus.model.mesh_surface import MeshSurface
from skinbus.model.surface import places_on
from skinbus.robot.chain import load_chain

_STEP = 1e-5
"""m, of differences on a surface: on a radius of 40 mm they err by 1e-8 of themselves."""
_AROUND = _STEP * np.array([[0.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0]])[:, :, None]
"""(2, 5, 1) m: a place, and places before and behind it in s and in a."""
_UPPER = np.triu_indices(3)
LARGEST = float(np.finfo(np.float32).max)
"""What does not fit into a REAL32 is this, not infinite."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotContacts:
    """The contacts of one cycle on the robot; frames are link, base and tool.

    A contact pushes with ``-force * normal``: tactels measure no shear.

    valid              whether the joint positions were young enough; if not, all is NaN but in frame "link"
    positions          (n_joints,) rad or m, at the time of the cycle
    point, normal      (n, 3 frames, 3) m; outward unit normals
    covariance         (n, 3 frames, 3, 3) m^2, of the point: by that of s and a, and by the joints; NaN of a
                       contact without one
    force              (n,) N, along the normal
    jacobian           (n, 6, n_joints) of the point in the base: velocity, then angular velocity
    torques            (n_joints,) N m or N, of all contacts on the joints; what drives hold is its negative
    base_wrench        (6,) force (N) and moment (N m) of all contacts about the base, in the base frame
    """

    valid: bool
    positions: Floats
    point: Floats
    normal: Floats
    covariance: Floats
    force: Floats
    jacobian: Floats
    torques: Floats
    base_wrench: Floats

    def records(self) -> npt.NDArray[np.float32]:
        """Return the REAL32 members of contact records that are of the robot, (n, 24).

        In the base point, normal, force, covariance (xx xy xz yy yz zz); in the tool point, normal, force.
        """
        covariance = self.covariance[:, 1][:, *_UPPER]
        push = -self.force[:, None, None] * self.normal
        base, tool = ([self.point[:, k], self.normal[:, k], push[:, k]] for k in (1, 2))
        return to_single(np.concatenate([*base, covariance, *tool], axis=1))


def to_single(values: Floats) -> npt.NDArray[np.float32]:
    """Return values as REAL32; NaN, not known, as 0."""
    return np.clip(np.nan_to_num(values, nan=0.0), -LARGEST, LARGEST).astype(np.float32)


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross product: three times as fast as numpy's, with what that checks."""
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


_NEXT = np.array([1, 2, 0])
_LAST = np.array([2, 0, 1])


class RobotFrames:
    """Places the contacts of an arm.

    Raises:
        ConfigError: faults of the URDF, or of the arm file that goes with it.
        SkinbusError: lxml is not installed.
    """

    def __init__(self, arm: Arm) -> None:
        assert arm.robot
        self.arm = arm
        self.chain = chain = load_chain(arm.robot)
        self._shapes = arm.link_shapes.T
        surfaces = [link.surface for link in arm.links]
        self._meshes = [(k, mesh) for k, mesh in enumerate(surfaces) if isinstance(mesh, MeshSurface)]
        across = np.zeros((chain.n_joints, 3, 3))  # of axes: across @ v is the cross product
        across[:, (2, 0, 1), (1, 2, 0)] = chain.axis
        across[:, (1, 2, 0), (2, 0, 1)] = -chain.axis
        self._across, self._across_twice = across, across @ across

    def poses(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return poses in the base, of joints and the base itself, and of frames; positions (..., n_joints).

        (..., n_joints + 1, 4, 4) and (..., n_frames, 4, 4)
        """
        chain = self.chain
        angle = np.where(chain.linear, 0.0, positions)[..., None, None]
        motion = np.zeros((*positions.shape, 4, 4))
        motion[..., :3, :3] = (  # Rodrigues
            np.eye(3) + np.sin(angle) * self._across + (1.0 - np.cos(angle)) * self._across_twice
        )
        motion[..., :3, 3] = chain.axis * np.where(chain.linear, positions, 0.0)[..., None]
        motion[..., 3, 3] = 1.0
        X_PJ = chain.X_PJ @ motion
        X_BJ = np.empty((*positions.shape[:-1], chain.n_joints + 1, 4, 4))
        X_BJ[..., -1, :, :] = np.eye(4)
        for j, parent in enumerate(chain.parent.tolist()):
            X_BJ[..., j, :, :] = X_BJ[..., parent, :, :] @ X_PJ[..., j, :, :]
        return X_BJ, X_BJ[..., chain.carrier, :, :] @ chain.X_CF

    def place(self, contacts: Any, positions: Floats | None, sd: Floats | None = None) -> RobotContacts:
        """Return contacts on the robot.

        contacts:  columns as of the estimator: link, s, a (m), force (N), covariance (n, 3, 3) of s, a, force
        positions: (n_joints,) rad or m, finite; None where they are not known.
        sd:        (n_joints,) their standard deviations; None for zeros.
        """
        chain, n_links, valid = self.chain, len(self.arm.links), positions is not None
        q, deviation = (
            np.zeros(chain.n_joints) if x is None else np.array(x, np.float64) for x in (positions, sd)
        )
        link, force, variance = contacts.link, contacts.force, deviation * deviation
        X_BJ, X_BF = self.poses(q)
        X_BS = X_BF[link]

        places, normals = self._on_surfaces(link, contacts.s + _AROUND[0], contacts.a + _AROUND[1])
        places, normals = ((X_BS[:, :3, :3] @ x[..., None])[..., 0] for x in (places, normals))
        point, normal = places[0] + X_BS[:, :3, 3], normals[0]
        by_place = (places[1::2] - places[2::2]) / (2.0 * _STEP)  # (2, n, 3)
        pushes = -force[:, None] * normal

        # what joints do to the point: it moves and turns
        axes = (X_BJ[:-1, :3, :3] @ chain.axis[..., None])[..., 0]
        every = np.where(chain.linear[:, None], axes, _cross(axes, point[:, None] - X_BJ[:-1, :3, 3]))
        on, held = chain.moves[n_links + link], chain.moves[-1]
        move = every * on[..., None]
        angular = axes * (on & ~chain.linear)[..., None]

        # the same in link, base and tool
        X = np.tile(np.eye(4), (len(link), 3, 1, 1))
        X[:, 0], X[:, 2] = X_BF[n_links + link], X_BF[-1]
        R = X[..., :3, :3]
        back = R.swapaxes(2, 3)
        points = (back @ (point[:, None] - X[..., :3, 3])[..., None])[..., 0]
        normals = (back @ normal[:, None, :, None])[..., 0]
        by_place = by_place.transpose(1, 2, 0)
        of_place = by_place @ contacts.covariance[:, :2, :2] @ by_place.swapaxes(1, 2)
        against_tool = every * (on != held)[..., None]
        covariance = np.stack(
            [of_place, *(of_place + (v.swapaxes(1, 2) * variance) @ v for v in (move, against_tool))], 1
        )
        covariance = back @ covariance @ R
        base_wrench = np.concatenate([pushes, _cross(point, pushes)], -1).sum(axis=0)
        jacobian = np.concatenate([move, angular], -1).swapaxes(1, 2)
        torques = np.einsum("nkx,nx->k", move, pushes)

        covariance[contacts.covariance[:, 2, 2] <= 0.0] = np.nan  # at level kmeans
        if not valid:
            for array in (points[:, 1:], normals[:, 1:], covariance[:, 1:], jacobian, q):
                array[...] = np.nan
            torques[:] = base_wrench[:] = np.nan
        return RobotContacts(
            valid=valid,
            positions=q,
            point=points,
            normal=normals,
            covariance=covariance,
            force=force,
            jacobian=jacobian,
            torques=torques,
            base_wrench=base_wrench,
        )

    def _on_surfaces(self, link: Ints, s: Floats, a: Floats) -> tuple[Floats, Floats]:
        """Return points and outward normals (m, n, 3) of places (m, n) m on n links, in their surfaces."""
        points, normals = places_on(self._shapes[:, link], s, a)
        for k, mesh in self._meshes:
            on = link == k
            if on.any():
                points[:, on], normals[:, on] = mesh.position(s[:, on], a[:, on])
        return points, normals
