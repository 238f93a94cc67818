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

# place_dpram [BAR]: places the shared memory, an ivshmem device's third window, in the ISA hole at 0xD4000, where an ISA board
# has it; with the bytes BAR elsewhere there.
place_dpram() {
	bridge=/sys/bus/pci/devices/0000:00:00.0
	# The host bridge's PAM registers for 0xD0000 to 0xDFFFF (0x5C on i440FX, 0x93 on Q35): both halves to the bus.
	case $(cat $bridge/device) in 0x1237) pam=0x5c ;; *) pam=0x93 ;; esac
	config $bridge $pam '\x00\x00'
	board=$(pci_device 0x1af4 0x1110)
	config "$board" 4 '\x00\x00'
	config "$board" 0x18 "${1:-\\x0c\\x40\\x0d\\x00}"'\x00\x00\x00\x00'
	config "$board" 4 '\x02\x00'
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

# Interrupts as UIO has counted them, once no more come: a daemon that looks by itself may be ahead of them.
interrupts() {
	before=
	until now=$(cat /sys/class/uio/uio0/event); [ "$now" = "$before" ]; do
		before=$now
		sleep 0.7
	done
	echo "$now"
}

functions() { # NAME SPEC
	start_daemon "$2" || return
	say "begin functions-$1"
	sh /guest/functions.sh /run pmacctl --socket /run/pmac0.sock
	say "end functions-$1"
}

# Replies announced by interrupts, one line after the other, each compared.
many() { # LINES
	for ten in 0 1 2 3 4 5 6 7 8 9; do
		pmacctl --socket /run/pmac0.sock send "$(for one in 0 1 2 3 4 5 6 7 8 9; do printf 'P1%s%s=%s ' $ten $one $((ten * 10 + one)); done)" ||
			fail "P1${ten}0 to P1${ten}9 are not set"
	done
	i=0
	while [ $i -lt "$1" ]; do
		echo "P$((100 + i % 100))"
		i=$((i + 1))
	done >/run/lines
	sed 's/^P1//; s/^0*\(.\)/\1/' /run/lines >/run/expected
	read -r begun _ </proc/uptime
	pmacctl --socket /run/pmac0.sock terminal </run/lines >/run/replies
	read -r ended _ </proc/uptime
	cmp -s /run/expected /run/replies && ok "$1 replies" || fail "$1 lines sent, $(wc -l </run/replies) replies, not all of them right: $(diff /run/expected /run/replies | head -n 4 | xargs)"
	say "value lines_per_second $(echo "$1 $begun $ended" | awk '{ printf "%.0f", $1 / ($3 - $2) }')"
}

# refused WHAT SPEC TEXT: pmacd does not take that board, and says why.
refused() {
	said=$(timeout 20 pmacd --board "$2" --name pmac9 --socket /run/pmac9.sock 2>&1)
	case $? in
	0 | 124 | 143) fail "$1: pmacd took $2: $said" ;;
	*) expect_in "$1" "$3" "$(echo "$said" | grep -F "$3" || echo "$said")" ;;
	esac
}

# Gives a PCI device to uio_pci_generic.
bind_generic() { # DEVICE
	echo uio_pci_generic >"$1/driver_override"
	echo "${1##*/}" >/sys/bus/pci/drivers/uio_pci_generic/bind
}

# What the daemon said that somebody should hear, for whoever reads the console.
complaints() { grep -E 'WARN|ERROR' /run/pmacd.log | sed 's/^/   /'; }

# install_package: our package on the running system, as anybody would install it, with users of all roles.
install_package() {
	dpkg --install /pmac.deb >/run/dpkg.log 2>&1 && ok 'the package is installed' || { fail 'dpkg --install'; cat /run/dpkg.log; }
	systemd-sysusers /guest/users.conf 2>/run/sysusers.log || cat /run/sysusers.log
}

# purge_package: after it nothing of the package is there but its users.
purge_package() {
	dpkg --listfiles pmac-dpram >/run/files
	dpkg --purge pmac-dpram >/run/dpkg.log 2>&1 && ok 'the package is purged' || { fail 'dpkg --purge'; cat /run/dpkg.log; }
	expect 'no file of it is left' '' "$(while read -r file; do [ -d "$file" ] || ls "$file" 2>/dev/null; done </run/files; ls -d /run/pmacd /var/lib/pmacd 2>/dev/null)"
	expect 'nor a unit that runs' '' "$(systemctl list-units --no-legend --plain 'pmac*' | grep service)"
}
