"""Quadratic programs of the controller: random ones, and the dense form in which other solvers take them."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpc import Controller
from mpc.soft_limits import moved, prices
from plant import GearTrain, ServoModel
from plant.effects import ActuatorLag, Compliance

Array = NDArray[np.float64]


def responses(A: Array, B: Array) -> Array:
    """(M, n, M) derivatives of the states behind M samples by their torques, for A (M, n, n) and B (M, n, 2).

    S[k+1] = A[k] S[k] + B[k] e[k] + B'[k] e[k-1]
    """
    samples, n = A.shape[0], A.shape[1]
    S = np.zeros((samples, n, samples))
    S[0, :, 0] = B[0, :, 0]
    for k in range(1, samples):
        S[k, :, :k] = A[k] @ S[k - 1, :, :k]
        S[k, :, k] = B[k, :, 0]
        S[k, :, k - 1] += B[k, :, 1]
    return S


@dataclass(frozen=True, kw_only=True, eq=False)
class Stages:
    """A program as in `mpc.riccati`, written out: 1/2 |R e - target|^2 within bounds."""

    A: Array  # (N, n, n)
    B: Array  # (N, n, 2)
    miss: Array  # (N,), the first of no effect
    rate: Array  # (N,)
    end: Array  # (2,)
    P: Array  # (2, 2)
    w: float
    low: Array  # (N,)
    high: Array  # (N,)

    @property
    def rows(self) -> tuple[Array, Array]:
        """R and target, independent of any recursion backward."""
        N = self.miss.size
        S = responses(self.A, self.B)
        D = np.sqrt(self.w) * (np.eye(N) - np.eye(N, k=-1))
        root = np.linalg.cholesky(self.P).T
        R = np.vstack((S[:-1, 0, :], root @ S[-1, :2, :], D))
        return R, -np.concatenate((self.miss[1:], root @ self.end, np.sqrt(self.w) * self.rate))


def random_stages(rng: np.random.Generator, n: int, N: int, hardness: float) -> Stages:
    """Dynamics that neither grow nor die out at once, misses up to 10^hardness of what the bounds can mend."""
    A = np.eye(n) + 0.3 * rng.normal(size=(N, n, n))
    A /= np.maximum(np.max(np.abs(np.linalg.eigvals(A)), axis=1), 1.0)[:, None, None]
    root = rng.normal(size=(2, 2))
    width = rng.uniform(0, 1, (2, N)) * (rng.random(N) > 0.1)  # some stages leave no choice
    return Stages(
        A=A,
        B=rng.normal(size=(N, n, 2)) * [1.0, 0.3],
        miss=rng.normal(size=N) * 10**hardness / 100,
        rate=rng.normal(size=N),
        end=rng.normal(size=2) * 10**hardness / 100,
        P=root @ root.T + 0.01 * np.eye(2),
        w=float(10 ** rng.uniform(-2, 1)),
        low=-width[0],
        high=width[1],
    )


def servo_stages(rng: np.random.Generator, N: int, hardness: float) -> Stages:
    """A rigid servo at 5 ms, weighted for a bandwidth, far from where it should be: much harder to guess the bounds."""
    dt, J = 0.005, 2.0
    wave = 2 * np.pi * 10 ** rng.uniform(0, 1.3)
    w = 1.0 / (J**2 * wave**6 * dt**2)
    A, B = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[dt**2 / (2 * J), 0.0], [dt / J, 0.0]])
    away, slide, swing = rng.normal(size=3) * 10**hardness / 100 * [1.0, 3.0, 0.3]
    time = dt * np.arange(N + 1)
    miss = away + slide * time + swing * np.sin(rng.uniform(5, 100) * time)
    width = 2.0 * rng.uniform(0.5, 1, (2, N)) * np.where(rng.random(N) < 0.9, 1.0, 0.01)
    return Stages(
        A=np.tile(A, (N, 1, 1)),
        B=np.tile(B, (N, 1, 1)),
        miss=miss[:-1],
        rate=0.1 * rng.normal(size=N),
        end=np.array([miss[-1], slide]),
        P=np.array([[20.0, 1.0], [1.0, 0.2]]) * np.array([[1.0, 10 / wave], [10 / wave, (10 / wave) ** 2]]),
        w=w,
        low=-width[0],
        high=width[1],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Fences:
    """Intervals of the change of torque, the next angle and the next speed, and the prices of leaving them."""

    ends: Array  # (N, 3, 2)
    prices: Array  # (3,)
    moved: Array  # (3,)

    def rows(self, stages: Stages) -> Array:
        """(N, 3, N) of the torques, what each of the numbers is."""
        N, S = stages.miss.size, responses(stages.A, stages.B)
        return np.stack((np.eye(N) - np.eye(N, k=-1), S[:, 0, :], S[:, 1, :]), axis=1)


def fenced_stages(rng: np.random.Generator, N: int, hardness: float) -> tuple[Stages, Fences]:
    """A rigid servo that is pulled towards and over its limits, and sometimes begins beyond them."""
    stages, dt, J = servo_stages(rng, N, hardness), 0.005, 2.0
    ends = np.empty((N, 3, 2))
    rate = np.max(np.abs(stages.rate)) + 10 ** rng.uniform(-1.5, 0.5) if rng.random() < 0.5 else np.inf  # none is a way
    ends[:, 0] = [-rate, rate] - stages.rate[:, None]
    way, speed = np.ptp(stages.miss) + 1e-4, np.max(np.abs(np.diff(stages.miss))) / dt + 1e-3
    high = way * 10 ** rng.uniform(-1.5, 0.5) * (-1 if rng.random() < 0.2 else 1)
    ends[:, 1] = [high - 3 * way, high] if rng.random() < 0.7 else [-np.inf, np.inf]
    ends[:, 2] = speed * 10 ** rng.uniform(-1, 0.3) * np.array([-1.0, 1.0]) if rng.random() < 0.7 else [-np.inf, np.inf]
    return stages, Fences(ends=ends, prices=prices(stages.w, 2.0, J, dt)[1:], moved=moved(J, dt)[1:])


class Solver:
    """Both forms of the solver, on the arrays of a controller of n states that looks N samples ahead."""

    def __init__(self, n: int, N: int, *, fenced: bool = False) -> None:
        more = {
            2: (),
            3: (ActuatorLag(time_constant=0.02),),
            4: (Compliance(frequency=20.0, damping=0.1, motor_share=0.3),),
        }
        limit = 1.0 if fenced else np.inf
        self._controller = Controller(ServoModel(effects=more[n]), GearTrain.paper(), horizon=N, speed_limit=limit)
        self.program = self._controller._interpreted.program
        self.arrays = self._controller._arrays

    def limit(self, rounds: int) -> None:
        """Let both forms stop after so many sweeps."""
        self._controller._machine_code.layout.rounds = self.program.rounds = rounds

    def solve(
        self, stages: Stages, guess: Array | None = None, compiled: bool = False, fences: Fences | None = None
    ) -> tuple[Array, float]:
        """(N,) solution and its residual, from a guess (N,) of the bounds that hold."""
        self.load(stages, guess, fences)
        residual = self.machine_code() if compiled else self.program.solve()
        return self.arrays["e"].copy(), residual

    def load(
        self,
        stages: Stages,
        guess: Array | None = None,
        fences: Fences | None = None,
        pressed: Array | None = None,
    ) -> None:
        """Put a program into the arrays, and guesses of the bounds (N,) and other ends (N, rows) that hold."""
        self.program.pressed[:], self.program.forces[:] = 0.0 if pressed is None else pressed, 0.0
        if fences is not None:
            self.program.fence[:, 1:], self.program.prices[1:] = fences.ends, fences.prices
            self.program.moved[1:] = fences.moved
        a, data, bounds = self.arrays, self.program.data, self.program.bounds
        a["A"][:] = stages.A.transpose(0, 2, 1).ravel()
        a["B"][:] = stages.B.transpose(0, 2, 1).ravel()
        a["tuning"][:4] = stages.w, stages.P[0, 0], stages.P[0, 1], stages.P[1, 1]
        a["end"][:], a["unit"][0], data[:] = stages.end, 1.0, 0.0
        data[:, 0], data[:, 1], bounds[:, 1], bounds[:, 2] = stages.miss, stages.rate, stages.low, stages.high
        bounds[:, 0] = 0.0 if guess is None else guess

    def machine_code(self) -> float:
        """Solve what is loaded; the residual."""
        code = self._controller._machine_code
        assert code.code.library is not None
        solve = code.code.library.solve
        solve.restype, solve.argtypes = ctypes.c_double, (ctypes.c_void_p,)
        return float(solve(ctypes.addressof(code.layout)))
