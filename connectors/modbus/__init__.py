"""Modbus over TCP, serial lines and RTU over TCP. Reads only: functions 3 and 4, nothing else.

``read_devices`` turns tables of a plant file into ``Device``s; ``DevicePoller`` polls one device
on an absolute schedule and delivers a ``SampleBatch`` for each poll. A register holds the present
value and no history: the samples go to the store, and recordings are read from there
(``StoredSamples``). Only ``connection.py`` uses pymodbus.
"""

from stemwatch.connectors.modbus.device import Device as Device
from stemwatch.connectors.modbus.poller import DevicePoller as DevicePoller
from stemwatch.connectors.modbus.read_devices import DeviceMap as DeviceMap
from stemwatch.connectors.modbus.read_devices import read_devices as read_devices
from stemwatch.connectors.modbus.register import Register as Register
from stemwatch.connectors.modbus.sample_batch import SampleBatch as SampleBatch
