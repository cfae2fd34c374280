"""What a plant is: LuGre friction, the drive, its effects and its linearisation."""

from frictionjax.physics.bristles import Bristles as Bristles
from frictionjax.physics.drive import Drive as Drive
from frictionjax.physics.effects import catalogue as catalogue
from frictionjax.physics.linearise import Linearization as Linearization
from frictionjax.physics.linearise import linearize as linearize
from frictionjax.physics.lugre import LuGre as LuGre
from frictionjax.physics.push import Push as Push
from frictionjax.physics.push import mean_of as mean_of
from frictionjax.physics.velocity_offset import VelocityOffset as VelocityOffset
