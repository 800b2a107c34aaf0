"""Modbus over TCP, serial lines and RTU over TCP. Reads only: functions 3 and 4, nothing else.

``read_devices`` turns tables of a plant file into ``Device``s; ``DevicePoller`` polls one device
on an absolute schedule and hands over a ``SampleBatch`` for each poll; ``ModbusConnector`` records
live through the protocol that every source of recordings has. pymodbus is known to ``line.py``
alone.
"""

from stemwatch.connectors.modbus.connector import ModbusConnector as ModbusConnector
from stemwatch.connectors.modbus.device import Device as Device
from stemwatch.connectors.modbus.poller import DevicePoller as DevicePoller
from stemwatch.connectors.modbus.read_devices import DeviceMap as DeviceMap
from stemwatch.connectors.modbus.read_devices import read_devices as read_devices
from stemwatch.connectors.modbus.register import Register as Register
from stemwatch.connectors.modbus.sample_batch import SampleBatch as SampleBatch
