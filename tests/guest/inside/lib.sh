# What every guest's part of a test is written in.

# The value of NAME=VALUE on the kernel's command line.
argument() { sed -n "s/.*pmac\.$1=\([^ ]*\).*/\1/p" /proc/cmdline; }

say() { echo "@@ $*"; }
ok() { say "ok $*"; }
fail() { say "FAIL $*"; }

# expect WHAT EXPECTED GOT: equal, or told with both.
expect() {
	if [ "$2" = "$3" ]; then ok "$1"; else fail "$1: expected \"$2\", got \"$3\""; fi
}

# expect_in WHAT EXPECTED GOT: EXPECTED (a shell pattern without its stars) somewhere in GOT.
expect_in() {
	case $3 in
	*$2*) ok "$1: \"$(echo "$3" | head -n 1)\"" ;;
	*) fail "$1: expected something with \"$2\", got \"$3\"" ;;
	esac
}

# wait_for SECONDS COMMAND...: until it succeeds.
wait_for() {
	deadline=$(($(cut -d. -f1 /proc/uptime) + $1))
	shift
	until "$@" >/dev/null 2>&1; do
		[ "$(cut -d. -f1 /proc/uptime)" -lt $deadline ] || return 1
		sleep 0.1
	done
}

# The device's directory below /sys/bus/pci/devices, by vendor and device number.
pci_device() {
	for device in /sys/bus/pci/devices/*; do
		[ "$(cat "$device/vendor"):$(cat "$device/device")" != "$1:$2" ] || { echo "$device"; return; }
	done
	return 1
}

# config DEVICE OFFSET BYTES: writes PCI configuration space; BYTES as printf has them.
config() { printf "$3" | dd of="$1/config" bs=1 seek=$(($2)) conv=notrunc 2>/dev/null; }

# Places the shared memory, an ivshmem device's third window, in the ISA hole at 0xD4000, where an ISA board has it.
place_dpram() {
	bridge=/sys/bus/pci/devices/0000:00:00.0
	# The host bridge's PAM register for 0xD0000 to 0xD7FFF (0x5C on i440FX, 0x93 on Q35): both halves to the bus.
	case $(cat $bridge/device) in 0x1237) pam=0x5c ;; *) pam=0x93 ;; esac
	config $bridge $pam '\x00'
	board=$(pci_device 0x1af4 0x1110)
	config "$board" 4 '\x00\x00'
	config "$board" 0x18 '\x0c\x40\x0d\x00\x00\x00\x00\x00'
	config "$board" 4 '\x02\x00'
}

load() {
	for module in "$@"; do insmod "/modules/$module.ko" || fail "insmod $module"; done
}

# start_daemon SPEC [OPTION...]: pmacd, until its servo data are live. $daemon is its process.
start_daemon() {
	spec=$1
	shift
	pmacd --board "$spec" --name pmac0 --socket /run/pmac0.sock "$@" >/run/pmacd.log 2>&1 &
	daemon=$!
	wait_for 20 pmacctl --socket /run/pmac0.sock motors && return
	fail "pmacd --board $spec: no live servo data"
	cat /run/pmacd.log
	pmacctl --socket /run/pmac0.sock doctor
	return 1
}

stop_daemon() {
	kill "$daemon"
	wait "$daemon"
	expect 'pmacd ends by itself' 0 $?
}

# Interrupts as UIO has counted them.
interrupts() { cat /sys/class/uio/uio0/event; }
