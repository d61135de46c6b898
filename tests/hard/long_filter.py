"""Millions of steps of one track's filter, and a month of a baseline, without leaving compiled code.

`python -m tests.hard.long_filter 100000000` runs the filter for that many steps and says what came of it.
"""

import sys
import time

import numpy as np

from skinbus.estimate.kernels.zeros import follow
from skinbus.estimate.tracking.filter import correct, covariance, predict
from skinbus.jit import setup


@setup
def run_filter(n_steps, seed):
    """Return (steps, code, least eigen-like ratio): code 1 a factor not positive, 2 P not symmetric positive.

    Steps from a microsecond to a second, contacts known from a tenth of a micrometre to ten centimetres and
    anything between along each axis, with correlations up to 0.999, and gaps in which nothing is seen.
    """
    np.random.seed(seed)
    x, U, D = np.zeros(5), np.eye(5), np.full(5, 1e-4)
    W, Dw, h, gain, dx = np.zeros((5, 10)), np.zeros(10), np.zeros(5), np.zeros(5), np.zeros(5)
    R, y, P = np.zeros((3, 3)), np.zeros(3), np.zeros((5, 5))
    least = np.inf
    for n in range(n_steps):
        dt = 10.0 ** (-6.0 * np.random.random())
        predict(x, U, D, dt, 0.01, 0.02, 100.0, W, Dw)
        if np.random.random() < 0.9:
            for i in range(3):
                R[i, i] = 10.0 ** (-14.0 + 12.0 * np.random.random())
            rho = 0.999 * (2.0 * np.random.random() - 1.0)
            R[0, 1] = R[1, 0] = rho * np.sqrt(R[0, 0] * R[1, 1])
            R[0, 2] = R[2, 0] = R[1, 2] = R[2, 1] = 0.0
            for i in range(3):
                y[i] = np.random.normal() * np.sqrt(R[i, i])
            correct(x, U, D, y, R, h, gain, dx)
        if n % 64 and n != n_steps - 1:
            for i in range(5):
                if not 0.0 < D[i] < np.inf:
                    return n, 1, least
            continue
        covariance(U, D, P)
        for i in range(5):
            if not 0.0 < D[i] < np.inf:
                return n, 1, least
            least = min(least, D[i] / P[i, i])
            for j in range(5):
                # Cauchy-Schwarz: a pair that breaks it would be no covariance
                if P[i, j] != P[j, i] or not P[i, j] * P[i, j] <= P[i, i] * P[j, j] * (1.0 + 1e-12):
                    return n, 2, least
    return n_steps, 0, least


@setup
def run_month(w, n_days, seed, out):
    """Follow zeros that swing by 2 kPa either way in a day, a touch of a minute every hour; fill ``out``.

    out: largest error of a zero while free, largest change of a zero within a touch (Pa), cycles in which a
    tactel that nothing touches counted as touched, cycles in which the touched one did not.
    """
    np.random.seed(seed)
    n = len(w.zero)
    pressures, truth = np.zeros(n), np.zeros(n)
    fresh = np.ones(len(w.quiet_s), np.bool_)
    held = 0.0
    for second in range(86400 * n_days):
        touching = second % 3600 >= 3540
        for i in range(n):
            truth[i] = 2000.0 * np.sin(2.0 * np.pi * second / 86400.0) * (2.0 * i / (n - 1) - 1.0)
            pressures[i] = truth[i] + 200.0 * np.random.normal()
        if touching:
            pressures[5] += 2e4
        follow(w, pressures, fresh, 1.0, 30.0, 0.5, 1.0)
        if second < 600:
            continue
        if second % 3600 == 3540:
            held = w.zero[5]
        for i in range(n):
            if touching:
                out[3] += i == 5 and not w.touched[i]
            if i != 5 or not touching:
                out[2] += w.touched[i] != 0
            if not touching:
                out[0] = max(out[0], abs(w.zero[i] - truth[i]))
        if touching:
            out[1] = max(out[1], abs(w.zero[5] - held))


def main():
    """Run the filter for as many steps as the command says."""
    n_steps = int(sys.argv[1]) if len(sys.argv) > 1 else 10**8
    run_filter(10, 1)
    start = time.perf_counter()
    done, code, least = run_filter(n_steps, 1)
    took = time.perf_counter() - start
    print(
        f"{done} steps, code {code}, least D/P {least:.2e}, {took:.0f} s ({1e6 * took / done:.2f} us a step)"
    )
    sys.exit(code)


if __name__ == "__main__":
    main()
