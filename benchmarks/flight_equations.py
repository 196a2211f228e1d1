"""The equations that the peer of `output_error.py` integrates: flat earth, a linear model, Euler angles.

`lib` gives sin, cos, asin, atan2 and sqrt, on numbers or on symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "north", "east", "down")
OUTPUTS = ("airspeed", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
FREE = (
    "CL_0", "CL_alpha", "CL_de", "CD_0", "CD_k", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cm_0", "Cm_alpha", "Cm_q",
    "Cm_de", "Cn_beta", "Cn_r", "Cn_dr",
)  # fmt: skip


def coefficients(x: Sequence[Any], surfaces: Sequence[Any], k: dict[str, Any], body: dict[str, float], lib: Any) -> Any:
    """V, alpha, beta and CL, CD, CY, Cl, Cm, Cn."""
    u, v, w, p, q, r = x[:6]
    de, da, dr = surfaces
    V = lib.sqrt(u * u + v * v + w * w)
    alpha, beta = lib.atan2(w, u), lib.asin(v / V)
    span, chord = body["b"] / (2.0 * V), body["c"] / (2.0 * V)
    CL = k["CL_0"] + k["CL_alpha"] * alpha + k["CL_de"] * de
    CD = k["CD_0"] + k["CD_k"] * CL * CL
    CY = k["CY_beta"] * beta + k["CY_dr"] * dr
    Cl = k["Cl_beta"] * beta + span * (k["Cl_p"] * p + k["Cl_r"] * r) + k["Cl_da"] * da
    Cm = k["Cm_0"] + k["Cm_alpha"] * alpha + k["Cm_q"] * q * chord + k["Cm_de"] * de
    Cn = k["Cn_beta"] * beta + span * (k["Cn_p"] * p + k["Cn_r"] * r) + k["Cn_da"] * da + k["Cn_dr"] * dr
    return V, alpha, beta, (CL, CD, CY, Cl, Cm, Cn)


def rates_and_outputs(
    x: Sequence[Any], surfaces: Sequence[Any], k: dict[str, Any], body: dict[str, float], lib: Any
) -> tuple[list[Any], list[Any]]:
    """Rates of STATES and OUTPUTS.

    surfaces: de, da, dr, rad. k: coefficients. body: mass, Ixx, Iyy, Izz, Ixz, S, b, c, rho, gravity, thrust in SI.
    """
    u, v, w, p, q, r, phi, theta, psi = x[:9]
    V, alpha, beta, (CL, CD, CY, Cl, Cm, Cn) = coefficients(x, surfaces, k, body, lib)
    qS = 0.5 * body["rho"] * V * V * body["S"]
    ca, sa = lib.cos(alpha), lib.sin(alpha)
    ax = (body["thrust"] + qS * (-CD * ca + CL * sa)) / body["mass"]
    ay = qS * CY / body["mass"]
    az = qS * (-CD * sa - CL * ca) / body["mass"]
    Ixx, Iyy, Izz, Ixz = (body[name] for name in ("Ixx", "Iyy", "Izz", "Ixz"))
    left = qS * body["b"] * Cl + Ixz * p * q - (Izz - Iyy) * q * r
    right = qS * body["b"] * Cn - Ixz * q * r - (Iyy - Ixx) * p * q
    determinant = Ixx * Izz - Ixz * Ixz
    sp, cp, st, ct = lib.sin(phi), lib.cos(phi), lib.sin(theta), lib.cos(theta)
    ss, cs = lib.sin(psi), lib.cos(psi)
    g = body["gravity"]
    turn = (q * sp + r * cp) / ct
    rates = [
        ax - g * st + r * v - q * w,
        ay + g * ct * sp + p * w - r * u,
        az + g * ct * cp + q * u - p * v,
        (Izz * left + Ixz * right) / determinant,
        (qS * body["c"] * Cm - (Ixx - Izz) * p * r - Ixz * (p * p - r * r)) / Iyy,
        (Ixz * left + Ixx * right) / determinant,
        p + turn * st,
        q * cp - r * sp,
        turn,
        ct * cs * u + (sp * st * cs - cp * ss) * v + (cp * st * cs + sp * ss) * w,
        ct * ss * u + (sp * st * ss + cp * cs) * v + (cp * st * ss - sp * cs) * w,
        -st * u + sp * ct * v + cp * ct * w,
    ]
    return rates, [V, alpha, beta, p, q, r, phi, theta, psi, ax, ay, az]
