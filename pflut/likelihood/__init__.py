"""The look-up table of likelihoods: learning it, storing it, evaluating it."""
