"""The study of grey methods: its claim and its findings."""

import pandas as pd

from testfield_studies.grey.page_relations import read_relations
from testfield_studies.grey.page_samples import read_samples
from testfield_studies.grey.plan import cases
from testfield.study.study import Findings, Study


def read(table: pd.DataFrame) -> Findings:
    """Both halves of the claim, one after the other; each says so where nothing of it is there yet."""
    first, second = read_samples(table), read_relations(table)
    return Findings(
        f"{first.verdict} {second.verdict}",
        first.sentences + second.sentences,
        first.tables + second.tables,
        first.plots + second.plots,
        {"grey uncertainty": first.figures, "grey relational analysis": second.figures},
    )


STUDY = Study(
    "grey",
    "Grey system theory: the uncertainty of small samples, and what drives accuracy",
    "The grey uncertainty, by a grey coefficient vector, evaluates small samples of an unknown law where statistics "
    "cannot; grey relational analysis finds which of many factors drive the accuracy of a vision measurement.",
    cases,
    read,
)
