"""Readers of files, one format a module, found by the file's suffix."""

from frictionjax.recordings.readers.base import AbstractColumnTable as AbstractColumnTable
from frictionjax.recordings.readers.base import Reader as Reader
from frictionjax.recordings.readers.registry import READERS as READERS
from frictionjax.recordings.readers.registry import open_table as open_table
from frictionjax.recordings.readers.registry import stem as stem
