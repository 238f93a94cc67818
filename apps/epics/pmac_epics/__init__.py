"""EPICS server of a PMAC motion controller, over pmacd: ``python -m pmac_epics``."""
