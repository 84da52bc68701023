"""Models and results for other programs: OpenSees."""

from bwbn_bayes.export.exportable import Exportable, Point, of_model, of_result
from bwbn_bayes.export.script import Script, script_of

__all__ = ["Exportable", "Point", "Script", "of_model", "of_result", "script_of"]
