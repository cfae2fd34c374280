"""Figures and tables of `frictionjax paper`."""

from frictionjax.report.paper.lines import paper_lines as paper_lines
from frictionjax.report.paper.tables import tables as tables
from frictionjax.report.paper.write import write_paper as write_paper
