# What the host's parts are written in. Sourced; $here is tests/guest.

root=$(cd "$here/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
cache=${PMAC_GUEST_CACHE:-$target/guest}
programs=$target/${PROFILE:-release}
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

# boot TEST IMAGE CORES APPEND [OPTION...]: a machine of emulated processors. Accelerators are not tried: some pretend.
boot() {
	test=$1
	image=$2
	cores=$3
	append=$4
	shift 4
	background console timeout 240 qemu-system-x86_64 -accel tcg -M pc -m 512 -smp "$cores" \
		-nodefaults -no-user-config -display none -no-reboot -serial stdio \
		-object "memory-backend-file,id=dpram,mem-path=$site/dpram,size=16K,share=on" -device ivshmem-plain,memdev=dpram \
		-qtest "unix:$site/qtest,server=on,wait=off" -qtest-log none \
		-kernel "$cache/kernel/vmlinuz" -initrd "$image" -append "console=ttyS0 quiet panic=-1 pmac.test=$test $append" "$@"
	machine=$last
}

# Every pulse that the simulated board gives becomes one on PIN.
bridge() { # PIN [ENDS]
	wait_for 10 "the machine's test socket" test -S "$site/qtest"
	pin=$1
	shift
	background bridge "$cache/bridge" "$site/irq" "$site/qtest" /machine/i440fx/ioapic "$pin" "$@"
	bridge=$last
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
