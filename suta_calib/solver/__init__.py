"""From terms to a solution: problem, evaluation, IPOPT, verdict."""
