# What the host's parts are written in. Sourced; $here is tests/guest.

root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
cache=${PMAC_GUEST_CACHE:-$target/guest}
kernel=$cache/${KERNEL:-kernel}
programs=$target/${PROFILE:-release}
pc=${PC:-qemu-system-x86_64 -cpu qemu64,-cx16 -m 512}
PATH=$PATH:/usr/sbin:/sbin

# A private directory for one guest, in memory: sockets, the console, the DPRAM. Everything started dies with it.
open_site() { # NAME
	name=$1
	site=$(mktemp -d "/dev/shm/pmac-guest-$name.XXXXXX")
	started=
	trap close_site EXIT
	trap 'exit 130' INT TERM
}

close_site() {
	for process in $started; do kill "$process" 2>/dev/null || true; done
	wait
	rm -rf "$site"
}

background() { # LOG COMMAND...
	log=$site/$1
	shift
	"$@" >"$log" 2>&1 </dev/null &
	last=$!
	started="$started $last"
}

fail() {
	echo "$name: FAIL $*" >&2
	[ ! -f "$site/console" ] || { echo "-- console, last lines" && tail -n 40 "$site/console"; } >&2
	exit 1
}

# wait_for SECONDS WHAT COMMAND...: until it succeeds.
wait_for() {
	tries=$(($1 * 20))
	what=$2
	shift 2
	until "$@" >/dev/null 2>&1; do
		tries=$((tries - 1))
		[ $tries -gt 0 ] || fail "$what: not there in time"
		sleep 0.05
	done
}

# simulator [OPTION...]: the board. Its memory is $site/dpram. Its servo is slower than a board's, as the machine that looks is.
simulator() {
	background simulator "$programs/pmac-sim" --memory "$site/dpram" --dpram-startup --servo-hz 1100 \
		--interrupt "unix:$site/irq" --control "unix:$site/control" "$@"
	simulator=$last
	wait_for 10 'the simulator' test -S "$site/control"
}

# QEMU 7.2 spoils the flags when it emulates the CMPXCHG16B that newer kernels allocate memory with; without it they do otherwise.
# boot TEST CORES APPEND [OPTION...]: a machine of emulated processors ($pc), and $dpram of shared memory (16K). Accelerators are not tried: some pretend.
boot() {
	test=$1
	cores=$2
	append=$3
	shift 3
	# shellcheck disable=SC2086 # words
	background console timeout 300 $pc -accel tcg -M pc -smp "$cores" \
		-nodefaults -no-user-config -display none -no-reboot -serial stdio \
		-object "memory-backend-file,id=dpram,mem-path=$site/dpram,size=${dpram:-16K},share=on" -device ivshmem-plain,memdev=dpram \
		-qtest "unix:$site/qtest,server=on,wait=off" -qtest-log none \
		-kernel "$kernel/vmlinuz" -initrd "$kernel/initramfs.gz" -append "console=ttyS0 quiet panic=-1 pmac.test=$test $append" "$@"
	machine=$last
}

# bridge RAISE LOWER WAIT: every interrupt of the simulated board becomes one of the machine (see bridge.rs).
bridge() {
	wait_for 10 "the machine's test socket" test -S "$site/qtest"
	background bridge "$cache/bridge" "$site/qtest" "$site/irq" "$@"
	bridge=$last
}

# An edge on a pin of the machine's I/O APIC. The board's controller waits for the guest to end it, at the port $site/ends.
bridge_edge() { # PIN
	line="set_irq_in /machine/i440fx/ioapic unnamed-gpio-in $1"
	bridge "$line 1" "$line 0" "ended:$site/ends"
}

# The interrupts the board gave, after which it is gone.
pulses() {
	kill "$simulator"
	wait "$bridge" || fail "the bridge: $(cat "$site/bridge")"
	pulses=$(sed -n 's/^pulses=\([0-9]*\).*/\1/p' "$site/bridge")
}

# The host port's interrupt controller: what the guest writes to its two registers is on file, and an end lets the next
# interrupt come. Words for boot.
host_port() {
	echo "-chardev socket,id=command,path=$site/ends,server=on,wait=off,logfile=$site/8259-command -device isa-debugcon,iobase=0x218,chardev=command \
		-chardev file,id=mask,path=$site/8259-mask -device isa-debugcon,iobase=0x219,chardev=mask"
}

# The guest's own verdict: no FAIL, and it came to its end.
guest_verdict() {
	wait "$machine" || true
	tr -d '\r' <"$site/console" >"$site/said"
	sed -n "s/^@@ ok /$name: ok /p" "$site/said"
	if grep '^@@ FAIL' "$site/said" | sed "s/^@@ FAIL/$name: FAIL/" >&2 && grep -q '^@@ FAIL' "$site/said"; then
		fail 'the guest found the above'
	fi
	grep -q '^@@ end' "$site/said" || fail 'the guest did not come to its end'
}

# The number that the guest gave under that name.
value() { sed -n "s/^@@ value $1 //p" "$site/said"; }

# The same functions have to give the same results as on a memory file.
same_functions() { # PASS...
	for pass in "$@"; do
		sed -n "/^@@ begin functions-$pass/,/^@@ end functions-$pass/p" "$site/said" | sed '1d;$d' >"$site/functions-$pass"
		[ "$(wc -l <"$site/functions-$pass")" -gt 100 ] || fail "the functions through $pass: no results"
		diff -u "$cache/functions-file" "$site/functions-$pass" >&2 || fail "the functions through $pass give other results than on a memory file"
		echo "$name: ok functions through $pass, $(wc -l <"$site/functions-$pass") lines as on a memory file"
	done
}
