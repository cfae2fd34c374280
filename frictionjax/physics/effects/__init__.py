"""Physics that the base model leaves out, one effect a file."""

from frictionjax.physics.effects.base import TEMPERATURES as TEMPERATURES
from frictionjax.physics.effects.base import About as About
from frictionjax.physics.effects.base import AbstractBristleEffect as AbstractBristleEffect
from frictionjax.physics.effects.base import AbstractCreepEffect as AbstractCreepEffect
from frictionjax.physics.effects.base import AbstractDampingEffect as AbstractDampingEffect
from frictionjax.physics.effects.base import AbstractEffect as AbstractEffect
from frictionjax.physics.effects.base import AbstractForceEffect as AbstractForceEffect
from frictionjax.physics.effects.base import AbstractInputEffect as AbstractInputEffect
from frictionjax.physics.effects.base import AbstractLevelEffect as AbstractLevelEffect
from frictionjax.physics.effects.base import AbstractLoadEffect as AbstractLoadEffect
from frictionjax.physics.effects.base import AbstractSensorEffect as AbstractSensorEffect
from frictionjax.physics.effects.base import AbstractSlipEffect as AbstractSlipEffect
from frictionjax.physics.effects.base import AbstractSpringEffect as AbstractSpringEffect
from frictionjax.physics.effects.base import AbstractStateEffect as AbstractStateEffect
from frictionjax.physics.effects.base import Before as Before
from frictionjax.physics.effects.base import LoadSide as LoadSide
from frictionjax.physics.effects.base import Now as Now
from frictionjax.physics.effects.catalogue import catalogue as catalogue
