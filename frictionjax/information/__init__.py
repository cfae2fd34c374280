"""What experiments can tell, before they are made: Fisher information, Cramer-Rao bounds, identifiability in words."""

from frictionjax.information.fisher import Information as Information
from frictionjax.information.fisher import fisher_information as fisher_information
from frictionjax.information.identifiability import Identifiability as Identifiability
from frictionjax.information.identifiability import NullDirection as NullDirection
from frictionjax.information.identifiability import identifiability as identifiability
from frictionjax.information.identifiability import information_of as information_of
