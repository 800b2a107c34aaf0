"""Watched folders: the samples of each export that is put there are stored once."""

from stemwatch.service.watch.folder import WatchedFolder as WatchedFolder
from stemwatch.service.watch.folder import take_in as take_in
from stemwatch.service.watch.limited_reader import Rejected as Rejected
