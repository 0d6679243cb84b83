"""Evidence: how probable a log is under a set of named effects, with everything unnamed taking part.

families      smooth torques and measurement errors that have no name
discrepancy   how large they are on a log, by its own data
marginal      log marginal likelihood of a fitted set of effects beside them
"""
