"""Types, parameters, errors as sentences and safe non-smooth maths: what every other package stands on."""

from frictionjax.core.errors import FrictionjaxWarning as FrictionjaxWarning
from frictionjax.core.errors import InputError as InputError
from frictionjax.core.errors import PrecisionError as PrecisionError
from frictionjax.core.estimate import Estimate as Estimate
from frictionjax.core.front_door import public_verb as public_verb
from frictionjax.core.parameters import Parameter as Parameter
from frictionjax.core.precision import require_x64 as require_x64
from frictionjax.core.progress import Progress as Progress
from frictionjax.core.progress import reporting as reporting
from frictionjax.core.progress import silent as silent
from frictionjax.core.setup import configure_jax as configure_jax
from frictionjax.core.setup import keep_compiled as keep_compiled
from frictionjax.core.setup import keep_memory as keep_memory
