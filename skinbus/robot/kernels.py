"""Kernels: poses of joints and frames, contacts in them, the torques and wrenches that contacts make.

Forward kinematics go through the joints in the order of the tree::

    R_BJ = R_BP R_PJ Rot(axis, q),   p_BJ = p_BP + R_BP p_PJ (+ R_BP R_PJ axis q of a prismatic joint)

A contact of force F at point p with outward normal n pushes with f = -F n. Joint k with axis z through o gets
the torque z . ((p - o) x f), or the force z . f if it is prismatic. A joint j behind it turns p and f, joints
before it turn all three: so d tau_k / d q_j is not zero only for j behind k.

Source: K. Lynch, F. Park, Modern Robotics (2017), 5.1 (geometric Jacobian), 5.2 (statics).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from skinbus.jit import inner_kernel, kernel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LINK, BASE, TOOL = 0, 1, 2
"""Frames of the output."""


@inner_kernel
def triple(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, cx: float, cy: float, cz: float
) -> float:
    """Return a . (b x c)."""
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


@inner_kernel
def pose_of(R: Floats, p: Floats, i: int, Q: Floats, q: Floats, j: int, S: Floats, s: Floats, k: int) -> None:
    """Write pose i of (R, p) times pose j of (Q, q) to row k of (S, s)."""
    for x in range(3):
        for y in range(3):
            S[k, x, y] = R[i, x, 0] * Q[j, 0, y] + R[i, x, 1] * Q[j, 1, y] + R[i, x, 2] * Q[j, 2, y]
        s[k, x] = p[i, x] + R[i, x, 0] * q[j, 0] + R[i, x, 1] * q[j, 1] + R[i, x, 2] * q[j, 2]


@inner_kernel
def copy_pose(Q: Floats, q: Floats, j: int, S: Floats, s: Floats, k: int) -> None:
    """Copy pose j of (Q, q) to row k of (S, s)."""
    for x in range(3):
        for y in range(3):
            S[k, x, y] = Q[j, x, y]
        s[k, x] = q[j, x]


@inner_kernel
def move(
    q: Floats,
    parent: Ints,
    linear: Ints,
    R_PJ: Floats,
    p_PJ: Floats,
    axis: Floats,
    carrier: Ints,
    R_CF: Floats,
    p_CF: Floats,
    R_BJ: Floats,
    p_BJ: Floats,
    z: Floats,
    R_BF: Floats,
    p_BF: Floats,
) -> None:
    """Write the poses of joints and frames in the base, and the axes of the joints there."""
    for j in range(len(parent)):
        if parent[j] < 0:
            copy_pose(R_PJ, p_PJ, j, R_BJ, p_BJ, j)
        else:
            pose_of(R_BJ, p_BJ, parent[j], R_PJ, p_PJ, j, R_BJ, p_BJ, j)
        u, v, w = axis[j, 0], axis[j, 1], axis[j, 2]
        for x in range(3):
            z[j, x] = R_BJ[j, x, 0] * u + R_BJ[j, x, 1] * v + R_BJ[j, x, 2] * w
        if linear[j]:
            for x in range(3):
                p_BJ[j, x] += z[j, x] * q[j]
            continue
        sin, cos = math.sin(q[j]), math.cos(q[j])
        rest = 1.0 - cos
        for x in range(3):  # a row of R Rot(axis, q), by Rodrigues
            a, b, c = R_BJ[j, x, 0], R_BJ[j, x, 1], R_BJ[j, x, 2]
            along = rest * z[j, x]
            R_BJ[j, x, 0] = cos * a + along * u + sin * (b * w - c * v)
            R_BJ[j, x, 1] = cos * b + along * v + sin * (c * u - a * w)
            R_BJ[j, x, 2] = cos * c + along * w + sin * (a * v - b * u)
    for f in range(len(carrier)):
        if carrier[f] < 0:
            copy_pose(R_CF, p_CF, f, R_BF, p_BF, f)
        else:
            pose_of(R_BJ, p_BJ, carrier[f], R_CF, p_CF, f, R_BF, p_BF, f)


@inner_kernel
def on_surface(links: Floats, link: int, s: float, a: float, t: Floats) -> None:
    """Write to t: point, normal, and the derivatives of both by s and a, (6, 3), in the surface's frame.

    The equations are those of ``model.surface``.
    """
    radius, taper, period, length = links[link, 0], links[link, 1], links[link, 2], links[link, 3]
    t[:] = 0.0
    if period == 0.0:
        t[0, 0], t[0, 1], t[1, 2], t[2, 0], t[3, 1] = s, a, 1.0, 1.0, 1.0
        return
    along = math.sqrt(1.0 - taper * taper)
    sin, cos = math.sin(a / radius), math.cos(a / radius)
    r = radius + taper * (s - 0.5 * length)
    t[0, 0], t[0, 1], t[0, 2] = s * along, r * sin, r * cos
    t[1, 0], t[1, 1], t[1, 2] = -taper, along * sin, along * cos
    t[2, 0], t[2, 1], t[2, 2] = along, taper * sin, taper * cos
    t[3, 1], t[3, 2] = r / radius * cos, -r / radius * sin
    t[5, 1], t[5, 2] = along / radius * cos, -along / radius * sin


@inner_kernel
def on_mesh(grid: Floats, nodes: Floats, link: int, s: float, a: float, t: Floats) -> None:
    """Write to t what :func:`on_surface` does, of a link that is a mesh.

    grid (n_links, 6) and nodes (n_nodes, 6) are those of ``model.mesh_surface``; beyond them the rim goes on.
    """
    step, n_s, n_a = grid[link, 2], int(grid[link, 3]), int(grid[link, 4])
    x, y = (s - grid[link, 0]) / step, (a - grid[link, 1]) / step
    i, j = min(max(math.floor(x), 0), n_s - 2), min(max(math.floor(y), 0), n_a - 2)
    x, y = min(max(x - i, 0.0), 1.0), min(max(y - j, 0.0), 1.0)
    k = int(grid[link, 5]) + i * n_a + j
    for part in range(2):
        for v in range(3):
            c = 3 * part + v
            low, high = nodes[k, c], nodes[k + n_a, c]
            low_across, high_across = nodes[k + 1, c] - low, nodes[k + n_a + 1, c] - high
            before, after = low + y * low_across, high + y * high_across
            t[part, v] = before + x * (after - before)
            t[2 + 2 * part, v] = (after - before) / step
            t[3 + 2 * part, v] = (low_across + x * (high_across - low_across)) / step
    size = math.sqrt(t[1, 0] * t[1, 0] + t[1, 1] * t[1, 1] + t[1, 2] * t[1, 2])
    for v in range(3):
        t[1, v] /= size
    for row in range(4, 6):  # of a unit vector: what is left across it
        along = t[row, 0] * t[1, 0] + t[row, 1] * t[1, 1] + t[row, 2] * t[1, 2]
        for v in range(3):
            t[row, v] = (t[row, v] - along * t[1, v]) / size


@inner_kernel
def turn(R: Floats, f: int, out: Floats, row: int, v: Floats, i: int) -> None:
    """Write R[f] v[i] to out[row]."""
    for x in range(3):
        out[row, x] = R[f, x, 0] * v[i, 0] + R[f, x, 1] * v[i, 1] + R[f, x, 2] * v[i, 2]


@inner_kernel
def turn_back(R: Floats, f: int, v: Floats, i: int, out: Floats, c: int, frame: int) -> None:
    """Write R[f]' v[i] to out[c, frame]."""
    for x in range(3):
        out[c, frame, x] = R[f, 0, x] * v[i, 0] + R[f, 1, x] * v[i, 1] + R[f, 2, x] * v[i, 2]


@inner_kernel
def express(R: Floats, f: int, C: Floats, out: Floats, c: int, frame: int) -> None:
    """Write R[f]' C R[f] to out[c, frame]."""
    for x in range(3):
        for y in range(x + 1):
            v = 0.0
            for k in range(3):
                for m in range(3):
                    v += R[f, k, x] * C[k, m] * R[f, m, y]
            out[c, frame, x, y] = v
            out[c, frame, y, x] = v


@kernel
def place(
    q: Floats,
    variance: Floats,
    parent: Ints,
    linear: Ints,
    R_PJ: Floats,
    p_PJ: Floats,
    axis: Floats,
    carrier: Ints,
    R_CF: Floats,
    p_CF: Floats,
    moves: Ints,
    R_BJ: Floats,
    p_BJ: Floats,
    z: Floats,
    R_BF: Floats,
    p_BF: Floats,
    links: Floats,
    grid: Floats,
    nodes: Floats,
    t: Floats,
    w: Floats,
    C: Floats,
    slope: Floats,
    link: Ints,
    s: Floats,
    a: Floats,
    force: Floats,
    covariance: Floats,
    point: Floats,
    normal: Floats,
    place_covariance: Floats,
    jacobian: Floats,
    torque: Floats,
    torque_covariance: Floats,
    wrench: Floats,
    link_wrench: Floats,
) -> None:
    """Place the contacts of a cycle in all frames, and write what they do to joints, links and base.

    q, variance       (n_joints,) positions and their variances
    parent ... moves  the chain; R_BJ ... p_BF room for its poses
    links             (n_links, 4) radius, taper, period, length; grid, nodes  those of meshes
    t, w (6, 3), C (2, 3, 3), slope (n_joints, n_joints) and (n_joints, 3) behind it: room
    link, s, a, force, covariance   columns of the contacts, (n,) and (n, 3, 3)

    Outputs, zeroed here where they add up:

    point, normal     (n, 3 frames, 3)
    place_covariance  (n, 3 frames, 3, 3)
    jacobian          (n, 6, n_joints) velocity of the point, then turning, by joint velocities, in the base
    torque            (n_joints,) and torque_covariance (n_joints, n_joints)
    wrench            (6,) force and moment about the base, in the base
    link_wrench       (n_links, 6) of each link's contacts: about the link's frame, in it
    """
    move(q, parent, linear, R_PJ, p_PJ, axis, carrier, R_CF, p_CF, R_BJ, p_BJ, z, R_BF, p_BF)
    n_joints, n_links = len(parent), len(links)
    tool = 2 * n_links
    torque[:] = 0.0
    torque_covariance[:] = 0.0
    wrench[:] = 0.0
    link_wrench[:] = 0.0
    slope[:] = 0.0
    for c in range(len(s)):
        surface = link[c]
        frame = n_links + surface
        if grid[surface, 5] < 0.0:
            on_surface(links, surface, s[c], a[c], t)
        else:
            on_mesh(grid, nodes, surface, s[c], a[c], t)
        for i in range(6):
            turn(R_BF, surface, w, i, t, i)
        for x in range(3):
            w[0, x] += p_BF[surface, x]
        px, py, pz = w[0, 0], w[0, 1], w[0, 2]
        nx, ny, nz = w[1, 0], w[1, 1], w[1, 2]
        F = force[c]
        fx, fy, fz = -F * nx, -F * ny, -F * nz

        # of the point, by s and a: in the base and, seen from it, in link and tool
        for x in range(3):
            for y in range(3):
                v = covariance[c, 0, 0] * w[2, x] * w[2, y] + covariance[c, 1, 1] * w[3, x] * w[3, y]
                v += covariance[c, 0, 1] * (w[2, x] * w[3, y] + w[3, x] * w[2, y])
                C[0, x, y] = C[1, x, y] = v
        express(R_BF, frame, C[0], place_covariance, c, LINK)
        for k in range(n_joints):
            on, held = moves[frame, k], moves[tool, k]
            ox, oy, oz = px - p_BJ[k, 0], py - p_BJ[k, 1], pz - p_BJ[k, 2]
            zx, zy, zz = z[k, 0], z[k, 1], z[k, 2]
            vx, vy, vz = zx, zy, zz
            if not linear[k]:
                vx, vy, vz = zy * oz - zz * oy, zz * ox - zx * oz, zx * oy - zy * ox
            for x in range(6):
                jacobian[c, x, k] = 0.0
            if on:
                jacobian[c, 0, k], jacobian[c, 1, k], jacobian[c, 2, k] = vx, vy, vz
                if not linear[k]:
                    jacobian[c, 3, k], jacobian[c, 4, k], jacobian[c, 5, k] = zx, zy, zz
                torque[k] += vx * fx + vy * fy + vz * fz
            if variance[k] > 0.0:
                for x in range(3):
                    for y in range(3):
                        vv = (vx, vy, vz)[x] * (vx, vy, vz)[y] * variance[k]
                        if on:
                            C[0, x, y] += vv
                        if on != held:
                            C[1, x, y] += vv
        # torques by s, a and force, then by the joints behind
        for k in range(n_joints):
            if not moves[frame, k]:
                for x in range(3):
                    slope[n_joints + k, x] = 0.0
                continue
            zx, zy, zz = z[k, 0], z[k, 1], z[k, 2]
            ox, oy, oz = px - p_BJ[k, 0], py - p_BJ[k, 1], pz - p_BJ[k, 2]
            for i in range(2):
                dx, dy, dz = -F * w[4 + i, 0], -F * w[4 + i, 1], -F * w[4 + i, 2]
                if linear[k]:
                    slope[n_joints + k, i] = zx * dx + zy * dy + zz * dz
                else:
                    slope[n_joints + k, i] = triple(zx, zy, zz, ox, oy, oz, dx, dy, dz) + triple(
                        zx, zy, zz, w[2 + i, 0], w[2 + i, 1], w[2 + i, 2], fx, fy, fz
                    )
            if linear[k]:
                slope[n_joints + k, 2] = -(zx * nx + zy * ny + zz * nz)
            else:
                slope[n_joints + k, 2] = -triple(zx, zy, zz, ox, oy, oz, nx, ny, nz)
            for j in range(k + 1, n_joints):
                if not moves[frame, j] or variance[j] == 0.0:
                    continue
                gx, gy, gz = 0.0, 0.0, 0.0  # how f turns with j
                if not linear[j]:
                    gx = z[j, 1] * fz - z[j, 2] * fy
                    gy = z[j, 2] * fx - z[j, 0] * fz
                    gz = z[j, 0] * fy - z[j, 1] * fx
                if linear[k]:
                    slope[k, j] += zx * gx + zy * gy + zz * gz
                else:
                    vx, vy, vz = jacobian[c, 0, j], jacobian[c, 1, j], jacobian[c, 2, j]
                    slope[k, j] += triple(zx, zy, zz, ox, oy, oz, gx, gy, gz)
                    slope[k, j] += triple(zx, zy, zz, vx, vy, vz, fx, fy, fz)
        for k in range(n_joints):
            for j in range(k + 1):
                v = 0.0
                for x in range(3):
                    for y in range(3):
                        v += slope[n_joints + k, x] * covariance[c, x, y] * slope[n_joints + j, y]
                torque_covariance[k, j] += v

        # the frames
        for x in range(3):
            point[c, BASE, x], normal[c, BASE, x] = w[0, x], w[1, x]
            for y in range(3):
                place_covariance[c, BASE, x, y] = C[0, x, y]
        express(R_BF, tool, C[1], place_covariance, c, TOOL)
        turn_back(R_BF, frame, w, 1, normal, c, LINK)
        turn_back(R_BF, tool, w, 1, normal, c, TOOL)
        for x in range(3):
            w[2, x] = w[0, x] - p_BF[frame, x]
            w[3, x] = w[0, x] - p_BF[tool, x]
        turn_back(R_BF, frame, w, 2, point, c, LINK)
        turn_back(R_BF, tool, w, 3, point, c, TOOL)

        # the wrenches
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += fz
        wrench[3] += py * fz - pz * fy
        wrench[4] += pz * fx - px * fz
        wrench[5] += px * fy - py * fx
        lx, ly, lz = point[c, LINK, 0], point[c, LINK, 1], point[c, LINK, 2]
        fx, fy, fz = -F * normal[c, LINK, 0], -F * normal[c, LINK, 1], -F * normal[c, LINK, 2]
        link_wrench[surface, 0] += fx
        link_wrench[surface, 1] += fy
        link_wrench[surface, 2] += fz
        link_wrench[surface, 3] += ly * fz - lz * fy
        link_wrench[surface, 4] += lz * fx - lx * fz
        link_wrench[surface, 5] += lx * fy - ly * fx
    for k in range(n_joints):
        for j in range(k + 1):
            v = torque_covariance[k, j]
            for m in range(n_joints):
                v += slope[k, m] * slope[j, m] * variance[m]
            torque_covariance[k, j] = torque_covariance[j, k] = v
