"""A fit in words and numbers, in the order in which one asks: values, how sure, what hangs together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification.fit_result import Fit, FittedParameter


def fit_report(fit: Fit, *, correlated: float = 0.5) -> str:
    """The fit as text: one line a parameter, then the correlations above `correlated`."""
    quality = f"noise {fit.noise_std:.4g}, log-likelihood {fit.log_likelihood:.1f}, {fit.samples} samples"
    process = "output error" if fit.bandwidth == 0.0 else f"observer bandwidth {fit.bandwidth:.3g} rad/s"
    lines = [f"Fit of {len(fit.log.runs)} run(s): {quality}, {process}", ""]
    width = max(len(p.name) for p in fit.parameters)
    lines += [f"  {p.name:<{width}}  {_value(p)}" for p in fit.parameters]
    pairs = correlations(fit, correlated)
    if pairs:
        lines += ["", f"  correlations above {correlated:g}"]
        lines += [f"    {a}, {b}: {r:+.3f}" for a, b, r in pairs]
    if not fit.converged:
        lines += ["", "  The iteration ended before it converged: look at the residual before you trust the numbers."]
    return "\n".join(lines)


def _value(p: FittedParameter) -> str:
    if p.fixed:
        return f"{p.value:.6g} {p.unit} (fixed)"
    if p.value is None or p.std is None:
        return f"cannot be told from this log (start {p.start:.4g} {p.unit})"
    share = f" ({100.0 * p.std / abs(p.value):.2g} %)" if p.value else ""
    bound = "  AT BOUND" if p.at_bound else ""
    return f"{p.value:.6g} +- {p.std:.2g} {p.unit}{share}  from {p.start:.4g}{bound}"


def correlations(fit: Fit, above: float) -> list[tuple[str, str, float]]:
    """Pairs of fitted parameters whose correlation is above a threshold in size, the largest first."""
    names = [fit.parameters[place].name for place in fit.free]
    table = fit.correlation
    pairs = [
        (names[i], names[j], float(table[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(table[i, j]) > above and not {names[i], names[j]} & set(fit.unidentifiable)
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))


def fit_to_dict(fit: Fit) -> dict[str, Any]:
    """The content of fit.json."""
    return {
        "schema": 1,
        "parameters": {
            p.name: {
                "value": p.value,
                "std": p.std,
                "unit": p.unit,
                "start": p.start,
                "fixed": p.fixed,
                "at_bound": p.at_bound,
                "identifiable": p.value is not None,
            }
            for p in fit.parameters
        },
        "correlations": [{"a": a, "b": b, "correlation": r} for a, b, r in correlations(fit, 0.0)],
        "noise_std": fit.noise_std,
        "observer_bandwidth": fit.bandwidth,
        "log_likelihood": fit.log_likelihood,
        "samples": fit.samples,
        "converged": fit.converged,
        "data": {"warnings": list(fit.log.warnings), "repairs": list(fit.log.repairs)},
        "source": [{"file": s.file, "sha256": s.sha256} for s in fit.log.sources],
    }
