# A Turbo PMAC2 whose DPRAM is 64 KiB: a memory BAR, then the same in the ISA hole at 0xD0000. No family is configured.
ctl() { pmacctl --socket /run/pmac0.sock "$@"; }

# answer LINE: what the board answers.
answer() { ctl send "$1" 2>&1; }

# look PASS SPEC: every function that a Turbo board has, once.
look() {
	start_daemon "$2" || return
	expect_in "$1: its family" turbo2 "$(ctl status | grep '^board')"
	expect "$1: motors" 32 "$(ctl motors --json | grep -o '"motor":' | wc -l)"
	wait_for 20 ctl send 'P1=17'
	expect "$1: a line and its reply" 17 "$(answer P1)"
	answer '#32J/' >/run/closed
	answer '#32J=2000' >/run/jogged
	wait_for 20 sh -c '[ "$(pmacctl --socket /run/pmac0.sock send "#32P")" = 2000 ]' && ok "$1: motor 32 moves" || fail "$1: motor 32 is at $(answer '#32P')"
	expect "$1: coordinate systems" 16 "$(ctl coordinates --json | grep -o '"coordinate_system":' | wc -l)"
	answer 'M5->Y:$10F0,0,16' >/run/defined
	answer 'M5=4711' >/run/written
	expect_in "$1: a register in the background" 4711 "$(ctl variable watch --count 1 'Y:$10F0' 2>&1)"
	# The last word of the user area, far above the 16 KiB of a small board; PMAC sees it as well.
	answer 'M6->Y:$061E1F,0,16' >/run/defined
	ctl write 'Y:$061E1F' 22136 >/run/written 2>&1 || fail "$1: $(cat /run/written)"
	expect "$1: a word above 16 KiB" 22136 "$(answer M6)"
	answer 'M6->*' >/run/defined
	ctl gather --source 32.actual_position --seconds 0.3 -o /run/samples.csv >/run/gathered 2>&1 || fail "$1: gather: $(cat /run/gathered)"
	[ "$(wc -l </run/samples.csv)" -gt 100 ] && ok "$1: gathered" || fail "$1: $(wc -l </run/samples.csv) lines gathered"
	stop_daemon
	complaints
}

memory=$(pci_device 0x1af4 0x1110)
look pci "pci:${memory##*/},bar=2,length=0x10000"
place_dpram '\x0c\x00\x0d\x00'
look mem mem:0xD0000,length=0x10000
