"""Evidence: how probable a log is under a set of effects. Each set includes the same discrepancy.

linearised    predictions of a fit, linearised in its parameters and in small torques and measurement errors
families      smooth functions for the unmodelled torque and the measurement error
discrepancy   the amplitude of these functions, estimated from the log
prior         prior density of an effect's parameters
marginal      log marginal likelihood of a fitted set of effects, with the discrepancy
set_likelihood  likelihood of a fit with the discrepancy, linearised at the fit
sizes         size of each effect and of the discrepancy, in one unit
signatures    change of the innovations by a small effect
explained_power, proposals  the one or two effects whose signatures explain most of the innovations
nonparametric_proposals  non-parametric effects that compete with those of the catalogue
fitted_sets   the sets that have been fitted, each once
larger_sets   sets with one or two more effects
search_over_sets  the search: larger, smaller and neighbouring sets, until none is more probable
posterior     probabilities of the sets, and of each effect
"""
