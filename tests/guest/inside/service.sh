# The package on a running Debian: the board appears, udev's rule starts the service, which has no right but the board.
. /guest/lib.sh
unit=pmacd@pmac0.service
property() { systemctl show --value -p "$1" "$unit"; }
process() { property MainPID; }
active() { [ "$(property ActiveState)" = active ]; }
# Another process than that one, and it is ready.
active_again() { active && [ "$(process)" != "$1" ] && [ "$(process)" != 0 ]; }
# Run as a user with the groups of a login.
as() { user=$1; shift; setpriv --reuid "$user" --regid "$(id -gn "$user")" --init-groups -- "$@"; }
# nobody_opens FILE...: no user but the service's and root, whatever its role, may open FILE, to write or to read.
nobody_opens() {
	for file; do
		for user in observer presser engineer other; do
			as $user sh -c 'exec 3>>"$0"' "$file" 2>/dev/null && fail "$user may write $file"
			as $user sh -c 'exec 3<"$0"' "$file" 2>/dev/null && fail "$user may read $file"
		done
		as pmacd sh -c 'exec 3<>"$0"' "$file" && ok "$file is pmacd's alone" || fail "pmacd may not open $file"
	done
}
trouble() { fail "$1"; systemctl status --no-pager --lines=30 "$unit"; ls -l /dev/uio* /dev/pmac*; }

install_package
mkdir -p "/etc/systemd/system/$unit.d"
cp /usr/share/pmacd/dropins/device.conf "/etc/systemd/system/$unit.d/"
systemctl daemon-reload

board=$(pci_device 0x1af4 0x1110)
dd if="$board/config" of=/run/window bs=1 skip=$((0x18)) count=8 2>/dev/null
place_dpram
expect 'nothing runs without a board' inactive "$(property ActiveState)"
modprobe pmac_dpram phys=0xd4000 irq=7 ioport=0x210 controller=pmac || fail 'modprobe pmac_dpram'
wait_for 20 active && ok 'the device starts its service' || trouble 'the device does not start its service'
expect 'its node' 'pmacd:root 600' "$(stat -c '%U:%G %a' /dev/uio0)"
expect 'its link' uio0 "$(readlink /dev/pmac0)"
wait_for 20 pmacctl motors && ok 'servo data' || { trouble 'no servo data'; pmacctl doctor; }

# What the process has.
status() { awk -v key="$1:" '$1 == key { print $2 }' "/proc/$(process)/status"; }
expect 'its user' "$(id -u pmacd)" "$(status Uid)"
expect 'its capabilities' '0000000000000000 0000000000000000 0000000000000000' "$(status CapEff) $(status CapPrm) $(status CapBnd)"
expect 'its system calls are filtered' 2 "$(status Seccomp)"
expect 'no new privileges' 1 "$(status NoNewPrivs)"
locked=$(status VmLck)
[ "${locked:-0}" -gt 4096 ] && ok "its memory is locked: $locked KiB" || fail "its memory is not locked: ${locked:-0} KiB"
expect 'its devices' '/dev/null /dev/uio0' "$(readlink "/proc/$(process)/fd/"* | grep '^/dev/[^s]' | sort -u | xargs)"
ok "exposure $(systemd-analyze security --no-pager "$unit" 2>&1 | sed -n 's/.*exposure level.*: \([0-9.]* [A-Z]*\).*/\1/p')"
expect 'links and files in /dev/shm are protected' 2 "$(cat /proc/sys/fs/protected_regular)"

# Who may what.
as observer pmacctl motors >/dev/null && ok 'a member of the group sees live data' || fail 'a member of the group sees no live data'
as observer pmacctl send P1 >/dev/null && ok 'it may ask for a variable' || fail 'a member of the group may not ask for a variable'
expect_in 'it may not send' 'not' "$(as observer pmacctl send P1=1 2>&1; echo "exit $?")"
as observer pmacctl send P1=1 >/dev/null 2>&1 && fail 'a member of the group may send'
as observer pmacctl send '^A' >/dev/null 2>&1 && fail 'a member of the group may abort'
as presser pmacctl send '^A' && ok 'an operator may abort' || fail 'an operator may not abort'
as presser pmacctl send P1=1 >/dev/null 2>&1 && fail 'an operator may send a line' || ok 'but not send a line'
as engineer pmacctl send P1=1 && ok 'an engineer may' || fail 'an engineer may not send a line'
as other pmacctl motors >/dev/null 2>&1 && fail 'anybody sees live data' || ok "somebody else does not: $(as other pmacctl motors 2>&1 | head -n 1)"
as other pmacctl send P1 >/dev/null 2>&1 && fail 'anybody may ask' || ok 'nor asks'

# No role opens the board itself, and the service works as before.
nobody_opens /dev/uio0
as engineer pmacctl send P1 >/dev/null && ok 'while commands are answered' || fail 'no command is answered beside that'

# A client that stays, whatever becomes of the daemon.
as observer pmacctl watch --seconds 120 >/run/watched 2>&1 &
client=$!
sees_more() {
	lines=$(wc -l </run/watched)
	wait_for 15 sh -c "[ \$(wc -l </run/watched) -gt $((lines + 3)) ]" && kill -0 $client
}
sees_more && ok 'a client sees updates' || fail 'a client sees no updates'

before=$(process)
kill -KILL "$before"
wait_for 20 active_again "$before" && ok 'killed, it is back' || trouble 'killed, it is not back'
sees_more && ok 'and the client with it' || fail "the client is lost: $(tail -n 3 /run/watched)"

before=$(process)
kill -STOP "$before"
wait_for 30 active_again "$before" && ok 'hung, the watchdog brings it back' || trouble 'hung, it is not brought back'
expect 'restarts' 2 "$(property NRestarts)"
sees_more && ok 'and the client with it' || fail "the client is lost: $(tail -n 3 /run/watched)"

# The board is taken out under the daemon, and put back.
driver=/sys/bus/platform/drivers/pmac-dpram
echo pmac-dpram.0 >$driver/unbind
wait_for 20 sh -c "! systemctl -q is-active $unit" && ok 'without its device it stops' || trouble 'without its device it does not stop'
wait_for 5 test ! -e /dev/pmac0 && ok 'the link goes' || fail 'the link stays'
rmmod pmac_dpram && ok 'and the driver' || fail 'rmmod pmac_dpram'
modprobe pmac_dpram phys=0xd4000 irq=7 ioport=0x210 controller=pmac
wait_for 20 active && ok 'the device back, the service is' || trouble 'the device is back, the service is not'
sees_more && ok 'and the client with it' || fail "the client is lost: $(tail -n 3 /run/watched)"
as engineer pmacctl send P1 >/dev/null && ok 'and commands are answered' || fail 'commands are not answered'
kill $client
systemctl stop "$unit"

# A name that somebody else has taken.
as other sh -c 'echo >/dev/shm/taken; chmod 666 /dev/shm/taken'
expect_in 'a segment of another user' "belongs to user $(id -u other)" "$(timeout 20 setpriv --reuid pmacd --regid pmac --clear-groups -- \
	pmacd --board uio:/dev/uio0 --name taken --socket /run/pmacd/taken.sock 2>&1 | grep pmacd:)"

# /dev/mem, with nothing, with the file's mode alone, and as the drop-in has it.
said() { timeout 20 setpriv --reuid pmacd --regid pmac --clear-groups --bounding-set -all -- pmacd --board mem:0xD4000 --name pmac8 --socket /run/pmacd/8.sock 2>&1; }
expect_in '/dev/mem without a right' 'you may not read and write /dev/mem' "$(said | grep pmacd:)"
chmod 666 /dev/mem
expect_in '/dev/mem without the capability' 'the capability CAP_SYS_RAWIO is missing' "$(said | grep pmacd:)"
chmod 640 /dev/mem
unit=pmacd@window.service
mkdir -p "/etc/systemd/system/$unit.d"
cp /usr/share/pmacd/dropins/dev-mem.conf "/etc/systemd/system/$unit.d/"
# Besides, processors that wake up in time, by the node's owner, because this systemd cannot hand it over.
cp /usr/share/pmacd/dropins/wake-up.conf "/etc/systemd/system/$unit.d/"
echo 'cpu_latency_us = 20' >>/etc/pmacd/window.toml
chown pmacd:root /dev/cpu_dma_latency && chmod 600 /dev/cpu_dma_latency
latency() { od -An -td4 -N4 /dev/cpu_dma_latency | tr -d ' '; }
expect 'nobody asks for processors that wake up in time' 2000000000 "$(latency)"
systemctl daemon-reload
systemctl start "$unit"
wait_for 20 pmacctl --name window motors && ok 'by /dev/mem with the drop-in' || trouble 'nothing by /dev/mem with the drop-in'
expect 'its user' "$(id -u pmacd)" "$(status Uid)"
expect 'its capabilities, dropped once the window is mapped' '0000000000000000 0000000000000000' "$(status CapEff) $(status CapPrm)"
expect 'the daemon does' 20 "$(latency)"
systemctl stop "$unit"
expect 'as long as it runs' 2000000000 "$(latency)"
say "value interrupts $(interrupts)"

# The same memory as a PCI board in a slot, its id no PMAC's own: the shipped rules leave the node to root, the one that doctor prints gives it to pmacd.
rmmod pmac_dpram
dd if=/run/window of="$board/config" bs=1 seek=$((0x18)) conv=notrunc 2>/dev/null
slot=${board##*/}
unit=pmacd@pmac0.service
echo "board = \"pci:$slot,bar=2\"" >/etc/pmacd/pmac0.toml
echo '[roles]
engineer = ["pmac-engineer"]' >>/etc/pmacd/pmac0.toml
sed "s/0000:03:00.0 0/$slot 2/; s/0000:03:00.0/$slot/" /usr/share/pmacd/dropins/pci.conf >"/etc/systemd/system/$unit.d/pci.conf"
systemctl daemon-reload
modprobe uio_pci_generic
bind_generic "$board"
wait_for 10 test -c /dev/uio0 || fail 'no UIO device'
udevadm settle
expect "another's node" 'root:root 600' "$(stat -c '%U:%G %a' /dev/uio0)"
pmacctl doctor --boards | sed -n 's/^ok    udev rule     //p' | grep -F "$slot" >/etc/udev/rules.d/59-pmacd.rules
expect_in 'the rule for the slot' "KERNELS==\"$slot\"" "$(cat /etc/udev/rules.d/59-pmacd.rules)"
udevadm control --reload
udevadm trigger --settle -s uio
wait_for 20 active && ok 'starts the service' || trouble 'the slot does not start its service'
wait_for 20 pmacctl motors && ok 'servo data' || { trouble 'no servo data by PCI'; pmacctl doctor; }
expect 'the slot has' 'pmacd:root 600' "$(stat -c '%U:%G %a' /dev/uio0)"
nobody_opens /dev/uio0 "$board/config" "$board/resource2"
as engineer pmacctl send P1 >/dev/null && ok 'while commands are answered' || fail 'no command is answered by PCI'
expect_in 'doctor' "/dev/uio0 is pmacd's alone" "$(pmacctl doctor --boards)"
systemctl stop "$unit"

# A VME card: three devices, one link, one service. Here its vectors and mailboxes lead nowhere, so it cannot answer TYPE.
rmmod uio_pci_generic
place_dpram '\x0c\xc0\x06\xd0'
printf 'board = "vme:/dev/pmac-vme0"\nfamily = "pmac"\n' >/etc/pmacd/pmac-vme0.toml
modprobe vme_fake memory=0xd0000000 && modprobe pmac_vme dpram=0x76c000 mailbox=0x7fa000 level=2 vector=0xa1 || fail 'modprobe pmac_vme'
unit=pmacd@pmac-vme0.service
wait_for 20 active && ok 'a VME card starts its service' || trouble 'a VME card does not start its service'
wait_for 20 pmacctl --name pmac-vme0 motors && ok 'servo data' || trouble 'no servo data by VME'
expect 'its link' uio2 "$(readlink /dev/pmac-vme0)"
expect 'its three nodes' 'pmacd:root 600 pmacd:root 600 pmacd:root 600' "$(stat -c '%U:%G %a' /dev/uio0 /dev/uio1 /dev/uio2 | xargs)"
expect 'and no other link' /dev/pmac-vme0 "$(ls -d /dev/pmac*)"
systemctl stop "$unit"
expect 'units that failed' '' "$(systemctl --failed --no-legend --plain | grep pmac)"
purge_package
echo '@@ end'
