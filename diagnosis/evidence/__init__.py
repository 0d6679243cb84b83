"""Evidence: how probable a log is under a set of named effects, with everything unnamed taking part.

linearised    predictions of a fit, linearised in its parameters and in small torques and measurement errors
families      smooth torques and measurement errors that have no name
discrepancy   how large they are on a log, by its own data
mode          the fit beside them, while they act on the load
prior         what is thought of an effect's parameters before a log is seen
weighed       a fit moved to that mode as far as the evidence rises
marginal      log marginal likelihood of a fitted set of effects beside them
sizes         how large each effect is, and the discrepancy, in one currency
signatures    which one or two effects more promise most
explore       the search over sets
posterior     their probabilities, and what may be said of each name
"""
