# An ISA board: its DPRAM at 0xD4000, its interrupt on IRQ 7, both through our own UIO driver.
place_dpram
load uio
# The addresses, the interrupt and the ports of a PMAC as delivered; behind the ports is what the test's host watches.
insmod /modules/pmac_dpram.ko phys=0xd4000 irq=7 ioport=0x210 controller=pmac || { fail 'insmod pmac_dpram'; dmesg | tail -n 5; }
expect 'UIO name' pmac-dpram "$(cat /sys/class/uio/uio0/name)"
expect 'UIO window' '0x00000000000d4000 0x0000000000004000 0x0' \
	"$(cd /sys/class/uio/uio0/maps/map0 && echo "$(cat addr)" "$(cat size)" "$(cat offset)")"
grep -q '000d4000-000d7fff : pmac-dpram' /proc/iomem && ok 'the window is claimed' || fail 'the window is not claimed'

functions() { # NAME SPEC
	start_daemon "$2" || return
	say "begin functions-$1"
	sh /guest/functions.sh /run pmacctl --socket /run/pmac0.sock
	say "end functions-$1"
}

# Replies announced by interrupts, one line after the other, each compared.
many() {
	lines=$(argument lines)
	for ten in 0 1 2 3 4 5 6 7 8 9; do
		pmacctl --socket /run/pmac0.sock send "$(for one in 0 1 2 3 4 5 6 7 8 9; do printf 'P1%s%s=%s ' $ten $one $((ten * 10 + one)); done)"
	done
	i=0
	while [ $i -lt "$lines" ]; do
		echo "P$((100 + i % 100))"
		i=$((i + 1))
	done >/run/lines
	sed 's/^P1//; s/^0*\(.\)/\1/' /run/lines >/run/expected
	read -r begun _ </proc/uptime
	pmacctl --socket /run/pmac0.sock terminal </run/lines >/run/replies
	read -r ended _ </proc/uptime
	cmp -s /run/expected /run/replies && ok "$lines replies" || fail "$lines lines sent, $(wc -l </run/replies) replies, not all of them right"
	say "value lines_per_second $(echo "$lines $begun $ended" | awk '{ printf "%.0f", $1 / ($3 - $2) }')"
}

for pass in $(argument passes | tr , ' '); do
	case $pass in
	mem) functions mem mem:0xD4000,irq=uio:/dev/uio0 ;;
	uio) functions uio uio:/dev/uio0 ;;
	file) functions file "file:$(pci_device 0x1af4 0x1110)/resource2" ;;
	esac || break
	[ "$pass" != "$(argument passes | sed 's/.*,//')" ] || many
	pmacctl --socket /run/pmac0.sock status | sed 's/^/   /'
	stop_daemon
	sed 's/^/   /' /run/pmacd.log | grep -E 'WARN|ERROR'
done
say "value interrupts $(interrupts)"
grep -E '^ *7:' /proc/interrupts
rmmod pmac_dpram && [ ! -e /dev/uio0 ] && ok 'the driver goes' || fail 'rmmod pmac_dpram'
expect 'and leaves nothing behind' '' "$(grep pmac-dpram /proc/iomem /proc/ioports)"
