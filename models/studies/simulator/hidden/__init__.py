"""Loops with physics beyond S and J hidden on purpose, for calibration and for the proof of
naming.
"""

from stemwatch.models.studies.simulator.hidden.case import EXCITED_PERCENT as EXCITED_PERCENT
from stemwatch.models.studies.simulator.hidden.case import HiddenCase as HiddenCase
from stemwatch.models.studies.simulator.hidden.case import simulate_hidden as simulate_hidden
from stemwatch.models.studies.simulator.hidden.catalogue import EFFECTS as EFFECTS
from stemwatch.models.studies.simulator.hidden.catalogue import PHYSICS as PHYSICS
from stemwatch.models.studies.simulator.hidden.catalogue import RECORD as RECORD
from stemwatch.models.studies.simulator.hidden.draws import draw_effect as draw_effect
from stemwatch.models.studies.simulator.hidden.draws import draw_hidden as draw_hidden
from stemwatch.models.studies.simulator.hidden.draws import draw_nulls as draw_nulls
from stemwatch.models.studies.simulator.hidden.draws import draw_unknown as draw_unknown
from stemwatch.models.studies.simulator.hidden.loops import CONCEALMENTS as CONCEALMENTS
from stemwatch.models.studies.simulator.hidden.unknown import NAMED_SINCE as NAMED_SINCE
from stemwatch.models.studies.simulator.hidden.unknown import RARE as RARE
from stemwatch.models.studies.simulator.hidden.unknown import UNKNOWN as UNKNOWN
