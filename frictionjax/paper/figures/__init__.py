"""Figures and tables of `frictionjax paper`."""

from frictionjax.paper.figures.lines import paper_lines as paper_lines
from frictionjax.paper.figures.tables import tables as tables
from frictionjax.paper.figures.write import write_paper as write_paper
