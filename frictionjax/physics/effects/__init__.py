"""Physics that the base model leaves out, one effect a file."""

from frictionjax.physics.effects.base import AbstractBristleEffect as AbstractBristleEffect
from frictionjax.physics.effects.base import AbstractEffect as AbstractEffect
from frictionjax.physics.effects.base import AbstractForceEffect as AbstractForceEffect
from frictionjax.physics.effects.base import AbstractInputEffect as AbstractInputEffect
from frictionjax.physics.effects.base import AbstractLevelEffect as AbstractLevelEffect
from frictionjax.physics.effects.base import AbstractSpringEffect as AbstractSpringEffect
from frictionjax.physics.effects.base import AbstractStateEffect as AbstractStateEffect
from frictionjax.physics.effects.catalogue import catalogue as catalogue
