"""Counts the evaluations that the Dormand-Prince pair of MATLAB's ode45 takes from rest to one steady state of
the kinematic robot with skid and roll resistance. Needs sympy and scipy: python docs/ode45.py"""
import time
import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

H, L, B = 0.144, 0.112, 0.0685
MASS, INERTIA = [1.04, 0.2, 0.2], [86e-4, 5e-4, 5e-4]
ROLL, SKID = [0.6, 0.3, 0.3], [104.0, 34.0, 45.0]
AMPLITUDE, OMEGA = np.radians(30), 3.9

t = sp.symbols("t")
x, y, theta = q = [sp.Function(name)(t) for name in ("x", "y", "theta")]
phi1, phi2 = AMPLITUDE * sp.cos(OMEGA * t), AMPLITUDE * sp.cos(OMEGA * t - sp.pi / 2)
angles = [theta, theta - phi1, theta + phi2]
tangents = [sp.Matrix([sp.cos(a), sp.sin(a)]) for a in angles]
r0 = sp.Matrix([x, y])
def positions(length):
    return [r0, r0 + H * tangents[0] + length * tangents[1], r0 - H * tangents[0] - length * tangents[2]]
kinetic = sum(
    m * r.diff(t).dot(r.diff(t)) / 2 + j * a.diff(t) ** 2 / 2
    for m, j, r, a in zip(MASS, INERTIA, positions(B), angles))
rayleigh = sum(
    c_r * r.diff(t).dot(u) ** 2 / 2 + c_s * r.diff(t).dot(sp.Matrix([-u[1], u[0]])) ** 2 / 2
    for c_r, c_s, r, u in zip(ROLL, SKID, positions(L), tangents))
equations = sp.Matrix([
    kinetic.diff(v.diff(t)).diff(t) - kinetic.diff(v) + rayleigh.diff(v.diff(t)) for v in q])
accelerations, rates, values = sp.symbols("a:3"), sp.symbols("w:3"), sp.symbols("q:3")
for derivative, symbols in ((2, accelerations), (1, rates), (0, values)):
    equations = equations.subs({v.diff(t, derivative) if derivative else v: s for v, s in zip(q, symbols)})
matrix = equations.jacobian(accelerations)
rest = equations.subs({a: 0 for a in accelerations})
function = sp.lambdify((t, values, rates), [matrix, rest], cse=True)

def rhs(time_s, state):
    m, b = function(time_s, state[:3], state[3:])
    return np.concatenate([state[3:], np.linalg.solve(m, -b.ravel())])

for rtol, atol in ((1e-3, 1e-6), (1e-6, 1e-9), (1e-9, 1e-12)):
    state, period, evaluations, displacement, cycles = np.zeros(6), 2 * np.pi / OMEGA, 0, 0.0, 0
    begin = time.perf_counter()
    while cycles < 500:
        solution = solve_ivp(rhs, (0, period), state, method="RK45", rtol=rtol, atol=atol)
        evaluations, cycles = evaluations + solution.nfev, cycles + 1
        after = solution.y[:, -1]
        before, displacement = displacement, np.hypot(*(after[:2] - state[:2]))
        state = np.concatenate([[0, 0], after[2:]])
        if abs(displacement - before) < max(rtol, 1e-8) * displacement:
            break
    print(f"RelTol {rtol:g}: d = {1e3 * displacement:.6f} mm after {cycles} cycles, "
          f"{evaluations} evaluations, {time.perf_counter() - begin:.2f} s here")
