"""Terms of the error model at a pose (displacements of places times random parameters), and their table.

Also all names needed to write the class of a source.
"""

from precision_pin.base import units as units
from precision_pin.base.arrays import Array as Array
from precision_pin.base.errors import Finding as Finding
from precision_pin.base.errors import InputError as InputError
from precision_pin.draws.draw import Draw as Draw
from precision_pin.draws.draw import Scope as Scope
from precision_pin.draws.draw import Setting as Setting
from precision_pin.draws.expressions import Expression as Expression
from precision_pin.draws.expressions import Value as Value
from precision_pin.draws.space import LabelledSpace as LabelledSpace
from precision_pin.draws.space import entry_name as entry_name
from precision_pin.robot.chain import Chain as Chain
from precision_pin.robot.chain import Posture as Posture
from precision_pin.robot.places import Factors as Factors
from precision_pin.robot.places import Load as Load
from precision_pin.robot.places import Place as Place
from precision_pin.terms.source import Dependence as Dependence
from precision_pin.terms.source import Source as Source
from precision_pin.terms.term import JointValue as JointValue
from precision_pin.terms.term import Term as Term
from precision_pin.terms.term import at_means as at_means
