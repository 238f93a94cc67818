# A VME card: DPRAM at $76C000, mailboxes at $7FA000, level 2, vectors $A0 to $A2, behind the kernel's vme_fake and our pmac_vme.
ctl() { pmacctl --socket /run/pmac0.sock "$@"; }
event() { cat "/sys/class/uio/$1/event"; }
counts() { echo "$(event uio0) $(event uio1) $(event uio2)"; }
# generate LEVEL VECTOR: an interrupt of the bridge's generator, which keeps only the last one until it is served.
generate() {
	echo $(($1 << 8 | $2)) >/sys/module/vme_fake/parameters/generate
	sleep 0.2
}

# place N ADDRESS-BYTES: the Nth shared memory where the bridge's windows find the card.
place() {
	n=0
	for device in /sys/bus/pci/devices/*; do
		[ "$(cat "$device/vendor"):$(cat "$device/device")" = 0x1af4:0x1110 ] || continue
		n=$((n + 1))
		[ $n = "$1" ] || continue
		config "$device" 4 '\x00\x00'
		config "$device" 0x18 "$2"'\x00\x00\x00\x00'
		config "$device" 4 '\x02\x00'
	done
}
place 1 '\x0c\xc0\x06\xd0'
place 2 '\x0c\xa0\x0f\xd0'

card='dpram=0x76c000 mailbox=0x7fa000 level=2 vector=0xa1'
# refuses WHAT TEXT PARAMETERS
refuses() {
	what=$1
	text=$2
	shift 2
	modprobe pmac_vme "$@" 2>/dev/null && { fail "$what: loaded"; rmmod pmac_vme; return; }
	expect_in "$what" "$text" "$(dmesg | tail -n 4 | grep -F "$text")"
}
refuses 'no bridge' 'no VME bus' $card
modprobe vme_fake memory=0xd0000000 pins=3,6,7 || fail 'modprobe vme_fake'
refuses 'no mailboxes' 'needs dpram, mailbox, level and vector' dpram=0x76c000
refuses 'level 8' 'levels 1 to 7' $card level=8
refuses 'vector 255' 'vector=0xff: a card takes' $card vector=255
refuses 'vector 254' 'vector=0xfe: a card takes' $card vector=254
refuses 'an even vector' 'vector=0xa2: a card takes' $card vector=0xa2
refuses 'half a page' 'no multiple' $card dpram=0x76e000
refuses 'address bits' 'takes 16, 24 or 32 bits' $card bits=20
refuses 'out of reach' 'dpram=0x1000000 is out of reach' $card dpram=0x1000000
refuses 'one vector twice' 'share a vector' dpram=0x76c000,0x770000 mailbox=0x7fa000,0x7fa200 level=2,2 vector=0xa1,0xa3
refuses 'the second card' 'card 1: level=0' dpram=0x76c000,0x770000 mailbox=0x7fa000,0x7fa200 level=2 vector=0xa1
expect 'what was refused leaves nothing' '' "$(ls /sys/class/uio)"

# Half of the bridge's eight windows are vme_user's: two cards get theirs. Somebody may have opened their devices by then.
modprobe vme_user bus=0 && modprobe pmac_vme dpram=0x76c000,0x770000,0x774000 mailbox=0x7fa000,0x7fa200,0x7fa400 level=2,2,2 vector=0xa1,0xb1,0xc1 ||
	fail "three cards beside vme_user: $(dmesg | tail -n 5)"
expect 'the third card fails, and two stay' 'pmac-vme0 pmac-vme1' "$(cat /sys/class/uio/*/name | grep -x 'pmac-vme.' | xargs)"
expect_in 'and the log says so' 'not every card works' "$(dmesg | tail -n 1)"
rmmod pmac_vme && rmmod vme_user && ok 'both modules go' || fail 'rmmod pmac_vme vme_user'

modprobe pmac_vme $card || { fail 'modprobe pmac_vme'; dmesg | tail -n 5; }
expect 'three devices' 'pmac-vme0-taken pmac-vme0-reply pmac-vme0' "$(cat /sys/class/uio/uio0/name /sys/class/uio/uio1/name /sys/class/uio/uio2/name | xargs)"
map() { (cd "/sys/class/uio/uio2/maps/map$1" && echo "$(cat name) $(cat addr) $(cat offset) $(cat size)"); }
expect 'the DPRAM' 'dpram 0x0000000000760000 0xc000 0x0000000000010000' "$(map 0)"
expect 'the mailboxes, beyond the first page' 'mailbox 0x00000000007f0000 0xa000 0x000000000000b000' "$(map 1)"
expect_in 'a board to be found' 'vme:/dev/uio2' "$(pmacctl doctor --boards 2>&1 | grep vme:)"

# Nobody uses the card yet: only the vector that comes counts, and a foreign one counts nowhere.
before=$(counts)
generate 2 0xa3
generate 3 0xa1
wait_for 5 sh -c 'dmesg | grep -q "Spurious VME interrupt, level:3, vector:a1"' || fail 'no spurious vector in the log'
expect 'a wrong vector and a wrong level are not served' "$before" "$(counts)"
expect_in 'they are told' 'level:2, vector:a3' "$(dmesg | grep 'Spurious')"
for vector in 0xa0 0xa1 0xa2; do
	generate 2 $vector
done
expect 'each vector has its own count' '1 1 1' "$(counts)"

# No more configuration than the node: the daemon selects the page, or the simulator shows no DPRAM.
start_daemon vme:/dev/uio2
[ "$(echo $(counts))" != '1 1 1' ] && ok 'vectors arrive' || fail "vectors: $(counts)"
many "$(argument lines)"
ctl status | grep -iE '^(board|lines|interrupt)' | sed 's/^/   /'

# While the board does not look at the DPRAM's port, lines go through the mailboxes.
through() { ctl status | grep -q 'through the VME mailboxes'; }
before=$(event uio0)
ctl send --yes I58=0 >/dev/null || fail 'I58=0'
expect 'a line through the mailboxes' 42 "$(ctl send P7=42 >/dev/null; ctl send P7)"
through && [ "$(event uio0)" -gt "$before" ] && ok 'the port is the mailboxes' || fail "not through the mailboxes: $(ctl status)"
ctl send I58=1 >/dev/null
wait_for 20 sh -c '! pmacctl --socket /run/pmac0.sock status | grep -q "through the VME mailboxes"' && ok 'and the DPRAM again' || fail 'lines stay with the mailboxes'

# A reset takes the page away, and the gathering that servo data need.
ctl send --timeout 20 SAVE >/run/saved 2>&1 || fail "SAVE: $(cat /run/saved)"
ctl send '$$$' >/run/reset 2>&1
wait_for 20 grep -q 'the board was reset' /run/pmacd.log && ok 'the board was reset' || fail "no reset: $(cat /run/reset)"
wait_for 20 ctl send GATHER
wait_for 20 ctl motors && ok 'the page is written again' || fail 'no live data after a reset'
expect 'and commands are answered' 43 "$(ctl send P7=43 >/dev/null; ctl send P7)"

# A second node of the device: its maps would not end with the bridge's windows.
mknod /run/second c "$((0x$(stat -c %t /dev/uio2)))" "$((0x$(stat -c %T /dev/uio2)))"
(exec 3<>/run/second) 2>/run/opened && fail 'a second node opens' || expect_in 'a second node is refused' 'busy' "$(cat /run/opened)"

# In use, the module stays.
rmmod pmac_vme 2>/dev/null && fail 'rmmod while pmacd uses it' || ok 'the module stays while it is in use'
wait_for 20 ctl motors && ok 'and pmacd with it' || fail 'pmacd has lost its board'
stop_daemon
complaints
(exec 3<>/run/second) && ok 'the second node opens once the first is closed' || fail 'the second node does not open'
sleep 1
say "value dpram $(($(event uio2) - 1))"
say "value taken $(($(event uio0) - 1))"
say "value reply $(($(event uio1) - 1))"

# Only servo data, of a known family: the mailboxes serve for the page alone, and no more interrupts come.
printf 'family = "pmac"\nfunctions = ["servo"]\n' >/run/servo.toml
start_daemon vme:/dev/uio2 --config /run/servo.toml
# The bridge's driver goes under the daemon. Its next access ends it, as another card may lie in the window then.
rmmod vme_fake || fail 'rmmod vme_fake'
wait $daemon
expect 'without its window the daemon ends' 69 $?
expect_in 'and says why' SIGBUS "$(grep SIGBUS /run/pmacd.log)"
expect 'its devices go' '' "$(ls /sys/class/uio)"
rmmod pmac_vme && ok 'the driver goes' || fail 'rmmod pmac_vme'
modprobe vme_fake memory=0xd0000000 && modprobe pmac_vme $card || fail 'the card does not come back'
start_daemon vme:/dev/uio2 --config /run/servo.toml && ok 'the card comes back, with live data'
stop_daemon
dmesg | grep -E 'BUG|WARNING:|Oops|Call Trace' && fail 'the kernel complains' || ok 'the kernel has no complaint'
