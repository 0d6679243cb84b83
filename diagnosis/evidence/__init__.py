"""Evidence: how probable a log is under a set of effects, beside a discrepancy that belongs to every set.

linearised    predictions of a fit, linearised in its parameters and in small torques and measurement errors
families      smooth torques and measurement errors of no particular law
discrepancy   how large they are on a log, by its own data
prior         of an effect's parameters, before a log is seen
marginal      log marginal likelihood of a fitted set of effects, with the discrepancy
weighed       a fit moved to the mode of that, as far as the evidence rises
sizes         how large each effect is, and the discrepancy, in one unit
signatures    what a small effect does to the innovations
explained_power, proposals  which one or two more effects explain most of them, by those signatures
without_name  non-parametric effects that compete with those of the catalogue
fitted_sets   the sets that have been fitted, each once
larger_sets   sets with one or two more effects
search_over_sets  the search: larger, smaller and neighbouring sets, until none is more probable
posterior     probabilities of the sets, and of each effect
"""
