"""Folders that exports are dropped into: each file is taken into the store once."""

from stemwatch.service.watch.folder import WatchedFolder as WatchedFolder
from stemwatch.service.watch.intake import take_in as take_in
from stemwatch.service.watch.limited_reader import Rejected as Rejected
