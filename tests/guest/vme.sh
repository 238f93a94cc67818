#!/bin/sh
# vme.sh [LINES]: a VME card behind pmac_vme and the kernel's vme_fake bridge: its windows on memory that the simulator plays, its page, its
# mailboxes, its three vectors, each on a line of its own of the machine (see vme_machine.c); LINES command lines through the DPRAM.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
lines=${1:-300}

open_site "vme${KERNEL:+-$KERNEL}"
# The page of VME address $76C000.
simulator --mailbox "$site/mailbox" --mailbox-taken "unix:$site/taken" --mailbox-response "unix:$site/reply" --dpram-page 0x1B
# A page of memory, as QEMU wants it; the board has the first 512 bytes.
truncate -s 4096 "$site/mailbox"
# A card holds its request until the bridge acknowledges it. Words for boot.
iack() { echo "-chardev socket,id=iack$1,path=$site/iack$1,server=on,wait=off -device isa-debugcon,iobase=$((0x218 + $1)),chardev=iack$1"; }
# shellcheck disable=SC2046 # words
boot vme 1 "pmac.lines=$lines" $(iack 0) $(iack 1) $(iack 2) -object "memory-backend-file,id=mailbox,mem-path=$site/mailbox,size=4K,share=on" -device ivshmem-plain,memdev=mailbox
pin() { echo "set_irq_in /machine/i440fx/ioapic unnamed-gpio-in $1 $2"; }
bridge "$(pin 7 1)" "$(pin 7 0)" "ended:$site/iack2" "$site/taken" "$(pin 3 1)" "$(pin 3 0)" "ended:$site/iack0" \
	"$site/reply" "$(pin 6 1)" "$(pin 6 0)" "ended:$site/iack1"
guest_verdict
pulses >/dev/null

# The bridge tells them in the order of its lines.
given=$(sed -n 's/^pulses=\([0-9]*\).*/\1/p' "$site/bridge" | tr '\n' ' ')
seen="$(value dpram) $(value taken) $(value reply) "
[ "$given" = "$seen" ] || fail "interrupts by v+1, v-1, v: the board gave $given, the guest saw $seen"
echo "$name: ok interrupts by v+1, v-1, v: $given, none lost, each under its own vector, $(value lines_per_second) lines a second"
