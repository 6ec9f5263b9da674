"""The four studies of accuracy theory: plans of cases, what each measures, and the findings with their rules."""
