"""LinuxCNC HAL component of a PMAC motion controller, over pmacd: ``loadusr -Wn pmac pmac-hal``."""
