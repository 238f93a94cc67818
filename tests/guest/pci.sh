#!/bin/sh
# pci.sh [LINES]: a PCI board: its memory through sysfs, its interrupt through uio_pci_generic, re-armed by the command register.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/common.sh"
lines=${1:-1000}

open_site pci
simulator
boot pci 1 "pmac.lines=$lines" -device edu
wait_for 60 "the device's address" grep -q '^@@ value edu' "$site/console"
edu=$(tr -d '\r' <"$site/console" | sed -n 's/^@@ value edu //p')
# edu raises INTx when its register 0x60 is written, and lowers it by 0x64.
bridge "writel $((edu + 0x60)) 1" "writel $((edu + 0x64)) 1" "served:$site/dpram"
guest_verdict
pulses

# The daemon may look before an interrupt tells it to, and a level may be seen twice; so this is no exact count.
seen=$(value interrupts)
[ "$pulses" -ge "$lines" ] && [ "$seen" -ge "$lines" ] || fail "$lines lines: the board gave $pulses interrupts, the guest saw $seen"
echo "$name: ok $pulses interrupts given, $seen seen, $(value lines_per_second) lines a second: INTx is armed again each time"
same_functions pci
