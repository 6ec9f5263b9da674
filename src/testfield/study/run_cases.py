"""The former place of `testfield.evaluate.execute`."""

from testfield.evaluate.execute import FAILURE, case_key, do_case, finished
from testfield.evaluate.execute import execute as run_cases

__all__ = ["FAILURE", "case_key", "do_case", "finished", "run_cases"]
