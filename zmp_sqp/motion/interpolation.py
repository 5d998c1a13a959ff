r"""Motions through samples, by the rules of the usual ROS controller.

With the samples (q_0, v_0, a_0) and (q_1, v_1, a_1) at the ends of an interval of the length h, the
`joint_trajectory_controller` of ros2_controllers plays

- positions alone: a straight line ("linear"), whose rates jump at the samples;
- positions and velocities: the cubic with

  .. math:: \ddot q(0) = \frac{6 (q_1 - q_0)}{h^2} - \frac{4 v_0 + 2 v_1}{h}, \quad
            \dddot q = \frac{6 (v_0 + v_1)}{h^2} - \frac{12 (q_1 - q_0)}{h^3}

- accelerations too: the polynomial of degree five with these six values ("quintic").

A "spline" is the rule here for positions alone: cubics with continuous accelerations (de Boor 1978,
A Practical Guide to Splines, chapter IV), with given rates at both ends. Positions with noise are
"smoothed": cubics with continuous accelerations that pass the samples at the distance of the noise
(Dierckx 1993, Curve and Surface Fitting with Splines).
"""

from __future__ import annotations

import numpy as np

from zmp_sqp.arrays import Array
from zmp_sqp.locks import without_warnings
from zmp_sqp.motion.trajectory import Trajectory

__all__ = [
    "RULES",
    "SMOOTHED",
    "cubic_motion",
    "linear_motion",
    "quintic_motion",
    "rate_jumps",
    "smoothed_motion",
    "spline_rates",
]

RULES = ("linear", "spline", "cubic", "quintic")
SMOOTHED = "smoothed"
ABOVE_NOISE = 1.2  # mean distance from the samples, per noise, that is too much


def linear_motion(names: tuple[str, ...], times: Array, q: Array) -> Trajectory | None:
    """Motion along straight lines from sample to sample; None if a rate jumps.

    Args:
        names: Names of the n joints.
        times: Shape (K,), from 0 on [s].
        q: Positions, shape (K, n) [rad or m].
    """
    rates = np.diff(q, axis=0) / np.diff(times)[:, None]
    if rate_jumps(times, q).any():
        return None
    zero = np.zeros_like(rates)
    return Trajectory(names, times, q, np.vstack([rates, rates[-1:]]), zero)


def rate_jumps(times: Array, q: Array) -> Array:
    """Jumps of the rates of straight lines at the inner samples, shape (K - 2, n), or zero.

    Jumps that rounding of the positions explains count as zero.
    """
    h = np.diff(times)[:, None]
    jumps = np.diff(np.diff(q, axis=0) / h, axis=0)
    noise = 16.0 * float(np.finfo(float).eps) * np.abs(q).max(axis=0)
    return np.where(np.abs(jumps) > noise * (1.0 / h[1:] + 1.0 / h[:-1]), jumps, 0.0)


def cubic_motion(names: tuple[str, ...], times: Array, q: Array, v: Array) -> Trajectory:
    """Motion of cubics through positions and velocities.

    Args:
        names: Names of the n joints.
        times: Shape (K,), from 0 on [s].
        q: Positions, shape (K, n) [rad or m].
        v: Velocities, shape (K, n) [rad/s or m/s].
    """
    h = np.diff(times)[:, None]
    mean = np.diff(q, axis=0) / h
    a = 2.0 * (3.0 * mean - 2.0 * v[:-1] - v[1:]) / h
    j = 6.0 * (v[:-1] + v[1:] - 2.0 * mean) / h**2
    return Trajectory(names, times, q, v, a, j)


def smoothed_motion(
    names: tuple[str, ...], times: Array, q: Array, noise: Array
) -> tuple[Trajectory, Array] | None:
    r"""Motion of smoothing cubic splines; None where they do not come near enough to the samples.

    Each spline has as few knots as leave it at a mean square distance from the samples of the
    square of the noise. Its knots are samples, so that it is a cubic between any two of them.

    Args:
        names: Names of the n joints.
        times: Shape (K,), from 0 on [s]; K is at least 4.
        q: Positions, shape (K, n) [rad or m].
        noise: Standard deviation of the noise of each joint's positions, shape (n,) [rad or m].

    Returns:
        The motion, and the standard deviation of each joint's rate at its ends, shape (n,) [rad/s
        or m/s]: that of the slope at the end of a cubic through m samples with the noise sigma on
        the spline's first or last piece, which has the length L (by Legendre polynomials)

        .. math:: \frac{2}{L} \sqrt{\frac{\sigma^2}{m} \sum_{k=0}^3 (2 k + 1) P_k'(1)^2}
                  = \frac{2 \sigma}{L} \sqrt{\frac{300}{m}}
    """
    from scipy.interpolate import UnivariateSpline

    found, rates, slopes = np.empty_like(q), np.empty_like(q), np.empty(len(noise))
    h = (times[-1] - times[0]) / (len(times) - 1)
    with without_warnings():  # what does not come near enough is found below
        for j, sigma in enumerate(noise):
            weights = np.full(len(times), 1.0 / sigma)
            spline = UnivariateSpline(times, q[:, j], w=weights, s=len(times), k=3)
            found[:, j], rates[:, j] = spline(times), spline(times, nu=1)
            piece = float(np.diff(spline.get_knots())[[0, -1]].min())
            slopes[j] = 2.0 * sigma / piece * np.sqrt(300.0 * h / piece)
    distance = np.sqrt(((found - q) ** 2).mean(axis=0))
    if not (distance <= ABOVE_NOISE * noise).all():
        return None
    return cubic_motion(names, times, found, rates), slopes


def quintic_motion(
    names: tuple[str, ...], times: Array, q: Array, v: Array, a: Array
) -> Trajectory:
    """Motion of polynomials of degree five through positions, velocities and accelerations.

    Args:
        names: Names of the n joints.
        times: Shape (K,), from 0 on [s].
        q: Positions, shape (K, n) [rad or m].
        v: Velocities, shape (K, n) [rad/s or m/s].
        a: Accelerations, shape (K, n) [rad/s^2 or m/s^2].
    """
    h = np.diff(times)[:, None]
    # what constant acceleration from the first sample misses at the second one
    far = np.diff(q, axis=0) - h * (v[:-1] + 0.5 * h * a[:-1])
    fast, strong = np.diff(v, axis=0) - h * a[:-1], np.diff(a, axis=0)
    third = (10.0 * far - 4.0 * h * fast + 0.5 * h**2 * strong) / h**3
    fourth = (-15.0 * far + 7.0 * h * fast - h**2 * strong) / h**4
    fifth = (6.0 * far - 3.0 * h * fast + 0.5 * h**2 * strong) / h**5
    return Trajectory(
        names,
        times,
        q,
        v,
        a[:-1],
        6.0 * third,
        snaps=24.0 * fourth,
        crackles=120.0 * fifth,
    )


def spline_rates(times: Array, q: Array, braking: Array, slack: float = 0.0) -> Array:
    r"""Rates at the samples of the cubic spline through positions, shape (K, n).

    A joint counts as at rest at the end if it can be: under an acceleration limit a it covers at
    most :math:`a h^2 / 2` in the last interval, of the length h, before it rests. If it covers
    more, its final rate is that of the cubic through the last four samples (fewer if there are
    fewer). The start is treated as the end.

    Args:
        times: Shape (K,), from 0 on [s].
        q: Positions, shape (K, n) [rad or m].
        braking: Acceleration limits, shape (n,) [rad/s^2 or m/s^2]; NaN or infinity where there is
            none, which leaves the estimate of the rate.
        slack: Rounding error of a difference of two positions [rad or m].
    """
    from scipy.interpolate import CubicSpline

    ends = []
    for order in (1, -1):
        t, positions = times[::order][:4], q[::order][:4]
        h = abs(t[1] - t[0])
        # scaled by h and relative to its first sample, for the digits
        powers = np.vander((t - t[0]) / h, increasing=True)
        estimate = np.linalg.solve(powers, positions - positions[0])[1] / h
        reach = 0.5 * np.where(np.isfinite(braking), braking, 0.0) * h**2
        covered = np.abs(positions[1] - positions[0])
        ends.append(np.where(covered <= reach * (1.0 + 1e-9) + slack, 0.0, estimate))
    spline = CubicSpline(times, q, bc_type=((1, ends[0]), (1, ends[1])))
    rates = np.asarray(spline(times, 1))
    rates[0], rates[-1] = ends
    return rates
