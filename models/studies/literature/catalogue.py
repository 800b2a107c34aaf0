"""Every model, in the order in which they are compared."""

from __future__ import annotations

from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.chen import CHEN_TREE
from stemwatch.models.studies.literature.choudhury import CHOUDHURY_AS_DRAWN, CHOUDHURY_TEXT
from stemwatch.models.studies.literature.he import HE2, HE3
from stemwatch.models.studies.literature.kano import KANO, KANO_ASYMMETRIC
from stemwatch.models.studies.literature.model import ValveModel
from stemwatch.models.studies.literature.physical.classical import CLASSICAL
from stemwatch.models.studies.literature.physical.dahl import DAHL
from stemwatch.models.studies.literature.physical.karnopp import KARNOPP
from stemwatch.models.studies.literature.physical.lugre import LUGRE
from stemwatch.models.studies.literature.physical.mueller import MUELLER
from stemwatch.models.studies.literature.stenman import STENMAN
from stemwatch.models.studies.literature.xch import XCH

DATA_DRIVEN: tuple[ValveModel, ...] = (
    CANONICAL,
    CHOUDHURY_TEXT,
    CHOUDHURY_AS_DRAWN,
    KANO,
    KANO_ASYMMETRIC,
    HE2,
    HE3,
    STENMAN,
    XCH,
    CHEN_TREE,
)
PHYSICAL: tuple[ValveModel, ...] = (CLASSICAL, KARNOPP, DAHL, LUGRE, MUELLER)
EVERY: tuple[ValveModel, ...] = DATA_DRIVEN + PHYSICAL
