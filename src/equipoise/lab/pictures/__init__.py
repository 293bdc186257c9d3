"""Pictures as files; importing it raises MissingDependencyError where Matplotlib is not installed."""

from equipoise.errors import MissingDependencyError

try:
    import matplotlib as matplotlib
except ModuleNotFoundError as error:
    raise MissingDependencyError("pictures need Matplotlib: pip install 'equipoise[pictures]'") from error
