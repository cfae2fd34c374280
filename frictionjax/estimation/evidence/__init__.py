"""What was measured, one kind of data a file: positions, forces, frequency responses."""

from frictionjax.estimation.evidence.base import AbstractEvidence as AbstractEvidence
from frictionjax.estimation.evidence.base import AbstractRecordings as AbstractRecordings
from frictionjax.estimation.evidence.driven import Observed as Observed
from frictionjax.estimation.evidence.driven import Schedule as Schedule
from frictionjax.estimation.evidence.driven import observed as observed
from frictionjax.estimation.evidence.forces import Forces as Forces
from frictionjax.estimation.evidence.forces import make_forces as make_forces
from frictionjax.estimation.evidence.imposed import Imposed as Imposed
from frictionjax.estimation.evidence.positions import Noise as Noise
from frictionjax.estimation.evidence.positions import Positions as Positions
from frictionjax.estimation.evidence.positions import filtered as filtered
from frictionjax.estimation.evidence.positions import filtered_in_pieces as filtered_in_pieces
from frictionjax.estimation.evidence.positions import scored_from_the_start as scored_from_the_start
from frictionjax.estimation.evidence.response import FrequencyResponse as FrequencyResponse
from frictionjax.estimation.evidence.response import make_response as make_response
