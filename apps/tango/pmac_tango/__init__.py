"""Tango device server of a PMAC motion controller, over pmacd: ``PmacEth INSTANCE``."""
