"""Other solvers in place of ours: each gets the quadratic program of a step and returns the change of the torques.

Only their own call is timed, without the conversion of the program into their form. A peer that is not installed is
listed as such (`pip install 'antidrive[bench]'`; acados is compiled from source, and found by its variable
ACADOS_SOURCE_DIR and its Python package `acados_template`).
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from random_quadratic_programs import responses

from mpc import Controller
from mpc.drive import DriveInverse

Array = NDArray[np.float64]


class Peer:
    """Solves a controller's programs in place of its own solver.

    It records the time of each [s], and the largest violation of the bounds [N m].

    Attributes:
        timed: description of the timed part, for the table.
    """

    timed = "its own call"

    def __init__(self, controller: Controller) -> None:
        self.controller, self.times, self.beyond = controller, [], 0.0
        self.step = controller._interpreted
        self.program = self.step.program
        controller._step = self.step
        self.program.solve = self.solve  # type: ignore[method-assign]
        self.N, self.n = self.program.e.size, self.program.s.shape[1] - 1
        P = controller._terminal_weight
        self.P, self.w = P, controller._rate_weight

    def solve(self) -> float:
        call = self.prepared()
        begin = time.perf_counter()
        e = call()
        self.times.append(time.perf_counter() - begin)
        bounds = self.program.bounds
        self.beyond = max(self.beyond, float(np.max(bounds[:, 1] - e)), float(np.max(e - bounds[:, 2])))
        bounds[:, 0], bounds[:, 1], bounds[:, 2] = -1.0, e, e  # our own sweep computes everything that follows from it
        self.program.sweep()
        return 0.0

    def prepared(self) -> Callable[[], Array]:
        raise NotImplementedError

    @property
    def stages(self) -> tuple[Array, Array]:
        """A (N, n, n) and B (N, n, 2)."""
        a = self.controller._arrays
        A = a["A"].reshape(-1, self.n, self.n).transpose(0, 2, 1)
        return A, a["B"].reshape(-1, 2, self.n).transpose(0, 2, 1)


class Condensed(Peer):
    """Only the torques as variables, dense."""

    def condensed(self) -> tuple[Array, Array, Array, Array]:
        """H (N, N) and g (N,) of the cost e'He/2 + g'e, and the bounds (N,) of e."""
        S = responses(*self.stages)
        D = np.eye(self.N) - np.eye(self.N, k=-1)
        miss, rate, end = self.program.data[1:, 0], self.program.data[:, 1], self.program.end
        H = S[:-1, 0].T @ S[:-1, 0] + S[-1, :2].T @ self.P @ S[-1, :2] + self.w * D.T @ D
        g = S[:-1, 0].T @ miss + S[-1, :2].T @ (self.P @ end) + self.w * (D.T @ rate)
        scale = 1.0 / np.max(np.diag(H))
        low, high = (np.ascontiguousarray(self.program.bounds[:, i]) for i in (1, 2))
        return np.ascontiguousarray(scale * H), scale * g, low, high


class Daqp(Condensed):
    """DAQP, warm-started from the plan."""

    def prepared(self) -> Callable[[], Array]:
        import daqp

        H, g, low, high = self.condensed()
        none, start = np.zeros((0, self.N)), np.clip(np.zeros(self.N), low, high)
        return lambda: daqp.solve(H, g, none, high, low, primal_start=start)[0]


class Conic(Condensed):
    """A solver that comes with CasADi, warm-started from the plan."""

    plugin: str
    options: dict[str, object]
    solver = None

    def prepared(self) -> Callable[[], Array]:
        H, g, low, high = self.condensed()
        start = np.clip(np.zeros(self.N), low, high)
        if self.solver is None:
            dense = {"h": ca.Sparsity.dense(self.N, self.N)}
            self.solver = ca.conic("peer", self.plugin, dense, {"print_time": False} | self.options)
        given = {"h": H, "g": g, "lbx": low, "ubx": high, "x0": start}
        return lambda: np.array(self.solver(**given)["x"]).ravel()


class QpOases(Conic):
    plugin, options = "qpoases", {"printLevel": "none"}


class Qrqp(Conic):
    plugin, options = "qrqp", {"print_iter": False, "print_header": False, "print_info": False}


class Sparse(Peer):
    """Torques and states as variables: e[0..N-1], z[1..N]."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        N, n = self.N, self.n
        self.size = N + N * n
        D = np.eye(N) - np.eye(N, k=-1)
        H = np.zeros((self.size, self.size))
        H[:N, :N] = self.w * D.T @ D
        for k in range(N - 1):
            H[N + n * k, N + n * k] = 1.0
        H[self.size - n : self.size - n + 2, self.size - n : self.size - n + 2] += self.P
        self.unit = 1.0 / np.max(np.abs(H[:N, :N]))
        self.H = sp.csc_matrix(H) * self.unit
        entries = []  # row, column, place of its value among 1, -A, -B
        for k in range(N):
            for i in range(n):
                row = n * k + i
                entries.append((row, N + row, 0))
                if k:
                    entries += [(row, N + n * (k - 1) + j, 1 + n * n * k + n * i + j) for j in range(n)]
                    entries.append((row, k - 1, 1 + n * n * N + 2 * (n * k + i) + 1))
                entries.append((row, k, 1 + n * n * N + 2 * (n * k + i)))
        rows, columns, self.places = (np.array(column) for column in zip(*entries, strict=True))
        self.order = np.lexsort((rows, columns))
        pattern = sp.csc_matrix((np.ones(rows.size), (rows, columns)), shape=(N * n, self.size))
        pattern.sort_indices()
        self.pattern = pattern

    def dynamics(self) -> sp.csc_matrix:
        A, B = self.stages
        values = np.concatenate(([1.0], -A.ravel(), -B.ravel()))
        E = self.pattern.copy()
        E.data[:] = values[self.places[self.order]]
        return E

    def linear(self) -> Array:
        data = self.program.data
        q = np.zeros(self.size)
        rate = np.append(data[:, 1], 0.0)
        q[: self.N] = self.w * (rate[:-1] - rate[1:])
        q[self.N : self.size - self.n : self.n] = data[1:, 0]
        q[self.size - self.n : self.size - self.n + 2] = self.P @ self.program.end
        return q * self.unit


class Osqp(Sparse):
    solver = None

    def prepared(self) -> Callable[[], Array]:
        import osqp

        E, N = self.dynamics(), self.N
        rows = sp.vstack((E, sp.eye(N, self.size)), format="csc")
        zero = np.zeros(E.shape[0])
        low = np.concatenate((zero, self.program.bounds[:, 1]))
        high = np.concatenate((zero, self.program.bounds[:, 2]))
        q = self.linear()
        if self.solver is None:
            self.solver = osqp.OSQP()
            options = {"eps_abs": 1e-6, "eps_rel": 1e-6, "verbose": False, "max_iter": 4000}
            self.solver.setup(sp.triu(self.H, format="csc"), q, rows, low, high, **options)

        def call() -> Array:
            self.solver.update(q=q, l=low, u=high, Ax=rows.data)
            return self.solver.solve(raise_error=False).x[:N]

        return call


class Piqp(Sparse):
    solver = None

    def prepared(self) -> Callable[[], Array]:
        import piqp

        E, q, N = self.dynamics(), self.linear(), self.N
        free = np.full(self.size - N, np.inf)
        low = np.concatenate((self.program.bounds[:, 1], -free))
        high = np.concatenate((self.program.bounds[:, 2], free))
        b = np.zeros(E.shape[0])
        if self.solver is None:
            self.solver = piqp.SparseSolver()
            self.solver.setup(self.H, q, E, b, None, None, None, low, high)

        def call() -> Array:
            self.solver.update(c=q, A=E, x_l=low, x_u=high)
            self.solver.solve()
            return np.array(self.solver.result.x[:N])

        return call


class DoMpc(Peer):
    """The nonlinear program with do-mpc's model, its discrete form and IPOPT with default settings."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import do_mpc
        predictor = controller.estimator.predictor
        model = do_mpc.model.Model("discrete", "SX")
        z, tau = model.set_variable("_x", "z", (self.n, 1)), model.set_variable("_u", "tau")
        names = ("wanted", "speed", "disturbance")
        wanted, speed, disturbance = (model.set_variable("_tvp", name) for name in names)
        model.set_rhs("z", predictor.stage(z, ca.vertcat(tau, tau) + disturbance, predictor.parameters)[0])
        model.setup()
        peer = do_mpc.controller.MPC(model)
        quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0}
        peer.set_param(n_horizon=self.N, t_step=controller.sample_time, store_full_solution=True, nlpsol_opts=quiet)
        miss = ca.vertcat(z[0] - wanted, z[1] - speed)
        peer.set_objective(lterm=(z[0] - wanted) ** 2, mterm=ca.mtimes(miss.T, ca.mtimes(ca.DM(self.P), miss)))
        peer.set_rterm(tau=self.w)
        reach = DriveInverse.of(controller.model)[0].effective(controller.bounds.reachable())
        peer.bounds["lower", "_u", "tau"], peer.bounds["upper", "_u", "tau"] = reach[0], reach[1]
        template, a = peer.get_tvp_template(), controller._arrays

        def preview(_: float) -> object:
            ahead = a["ahead"]
            template["_tvp", :, "wanted"] = list(ahead[: self.N + 1])
            end = (ahead[self.N + 1] - ahead[self.N - 1]) / (2 * controller.sample_time)
            template["_tvp", :, "speed"] = [end] * (self.N + 1)
            template["_tvp", :, "disturbance"] = [controller.estimator.disturbance] * (self.N + 1)
            return template

        peer.set_tvp_fun(preview)
        peer.setup()
        peer.set_initial_guess()
        self.peer = peer

    def prepared(self) -> Callable[[], Array]:
        a = self.controller._arrays
        state = a["states"][: self.n].reshape(-1, 1).copy()
        self.peer.u0 = np.array([[a["past"][self.controller._whole_delay + 1]]])
        self.peer.x0 = state

        def call() -> Array:
            self.peer.make_step(state)
            plan = np.asarray(self.peer.data.prediction(("_u", "tau"))).ravel()[: self.N]
            return plan - a["guess"]

        return call


class Acados(Peer):
    """Real-time iteration with HPIPM on the same model, best settings: discrete, full condensing, warm start.

    Three calls for all stages together: set the parameters, solve from the state, get the torques.
    """

    timed = "3 calls"

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver

        predictor, n = controller.estimator.predictor, self.n
        z, tau, last = ca.SX.sym("z", n), ca.SX.sym("tau"), ca.SX.sym("last")
        p = ca.SX.sym("p", 3)  # reference angle, reference speed, disturbance
        ahead = predictor.stage(z, ca.vertcat(tau, last) + p[2], predictor.parameters)[0]
        model, ocp = AcadosModel(), AcadosOcp()
        model.name, model.x, model.u, model.p = f"peer_{self.N}", ca.vertcat(z, last), tau, p
        model.disc_dyn_expr = ca.vertcat(ahead, tau)
        model.cost_y_expr = ca.vertcat(z[0] - p[0], tau - last)
        model.cost_y_expr_e = ca.vertcat(z[0] - p[0], z[1] - p[1])
        ocp.model, ocp.dims.N, ocp.parameter_values = model, self.N, np.zeros(3)
        ocp.cost.cost_type, ocp.cost.cost_type_e = "NONLINEAR_LS", "NONLINEAR_LS"
        ocp.cost.W, ocp.cost.W_e = np.diag([1.0, self.w]), self.P
        ocp.cost.yref, ocp.cost.yref_e = np.zeros(2), np.zeros(2)
        reach = DriveInverse.of(controller.model)[0].effective(controller.bounds.reachable())
        ocp.constraints.lbu, ocp.constraints.ubu = np.array([reach[0]]), np.array([reach[1]])
        ocp.constraints.idxbu, ocp.constraints.x0 = np.array([0]), np.zeros(n + 1)
        options = ocp.solver_options
        options.tf, options.integrator_type = self.N * controller.sample_time, "DISCRETE"
        options.cost_scaling = np.ones(self.N + 1)  # by default the length of the stage
        options.nlp_solver_type, options.hessian_approx = "SQP_RTI", "GAUSS_NEWTON"
        options.qp_solver, options.hpipm_mode = "FULL_CONDENSING_HPIPM", "SPEED_ABS"
        options.qp_solver_warm_start, options.print_level = 1, 0
        ocp.code_gen_options.code_export_directory = tempfile.mkdtemp()
        self.peer = AcadosOcpSolver(ocp, verbose=False)

    def feed(self) -> tuple[Array, Array]:
        """State and last torque (n + 1,), and the parameters (N + 1, 3)."""
        a, controller = self.controller._arrays, self.controller
        state = np.append(a["states"][: self.n], a["past"][controller._whole_delay + 1])
        ahead = a["ahead"]
        speed = (ahead[self.N + 1] - ahead[self.N - 1]) / (2 * controller.sample_time)
        ones = np.ones(self.N + 1)
        return state, np.column_stack((ahead[: self.N + 1], speed * ones, controller.estimator.disturbance * ones))

    def prepared(self) -> Callable[[], Array]:
        state, parameters = self.feed()
        peer, flat, guess = self.peer, np.ascontiguousarray(parameters.ravel()), self.controller._arrays["guess"]

        def call() -> Array:
            peer.set_flat("p", flat)
            peer.solve_for_x0(state, fail_on_nonzero_status=False, print_stats_on_failure=False)
            return peer.get_flat("u") - guess

        return call


class AcadosInside(Acados):
    """The same without the calls from Python: the time that acados itself states."""

    timed = "its own clock"

    def solve(self) -> float:
        found = super().solve()
        self.times[-1] = float(self.peer.get_stats("time_tot"))
        return found


class AcadosLoop(Acados):
    """The same with the loop of its examples: one ctypes call per stage."""

    timed = "ctypes"

    def prepared(self) -> Callable[[], Array]:
        state, parameters = self.feed()
        peer, guess = self.peer, self.controller._arrays["guess"]

        def call() -> Array:
            for k in range(self.N + 1):
                peer.set(k, "p", parameters[k])
            peer.set(0, "lbx", state)
            peer.set(0, "ubx", state)
            peer.solve()
            return np.array([peer.get(k, "u")[0] for k in range(self.N)]) - guess

        return call


KNOWN = (
    ("DAQP, condensed", "daqp", Daqp),
    ("qpOASES, condensed", "casadi", QpOases),
    ("qrqp, condensed", "casadi", Qrqp),
    ("PIQP, sparse", "piqp", Piqp),
    ("OSQP, sparse", "osqp", Osqp),
    ("acados RTI", "acados_template", Acados),
    ("acados RTI, solver alone", "acados_template", AcadosInside),
    ("acados RTI, stage by stage", "acados_template", AcadosLoop),
    ("do-mpc, IPOPT", "do_mpc", DoMpc),
)
PEERS = {name: kind for name, module, kind in KNOWN if importlib.util.find_spec(module)}
MISSING = [f"{name}, {kind.timed}" for name, _, kind in KNOWN if name not in PEERS]
