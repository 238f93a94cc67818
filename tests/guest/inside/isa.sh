# An ISA board: its DPRAM at 0xD4000, its interrupt on IRQ 7, both through our own UIO driver.
place_dpram

# Pages of the system's RAM are nobody's window, whatever the operator insists on. The kernel's own code is RAM for certain.
code=$(sed -n 's/^ *\([0-9a-f]*\)-.* : Kernel code/\1/p' /proc/iomem)
modprobe pmac_dpram "phys=0x$code" reserved=1 2>/dev/null && fail 'a window in RAM' || ok 'no window in RAM'
dmesg | tail -n 5 | grep -q "in pages of the system's RAM" && ok 'and the reason is told' || { fail 'not for that reason'; dmesg | tail -n 5; }

# The addresses, the interrupt and the ports of a PMAC as delivered; behind the ports is what the test's host watches.
modprobe pmac_dpram phys=0xd4000 irq=7 ioport=0x210 controller=pmac || { fail 'modprobe pmac_dpram'; dmesg | tail -n 5; }
expect 'UIO name' pmac-dpram "$(cat /sys/class/uio/uio0/name)"
expect 'UIO window' '0x00000000000d4000 0x0000000000004000 0x0' \
	"$(cd /sys/class/uio/uio0/maps/map0 && echo "$(cat addr)" "$(cat size)" "$(cat offset)")"
grep -q '000d4000-000d7fff : pmac-dpram' /proc/iomem && ok 'the window is claimed' || fail 'the window is not claimed'

for pass in $(argument passes | tr , ' '); do
	case $pass in
	mem) functions mem mem:0xD4000,irq=uio:/dev/uio0 ;;
	uio) functions uio uio:/dev/uio0 ;;
	lines) start_daemon uio:/dev/uio0 ;;
	esac || break
	[ "$pass" != "$(argument passes | sed 's/.*,//')" ] || many "$(argument lines)"
	pmacctl --socket /run/pmac0.sock status | sed 's/^/   /'
	stop_daemon
	complaints
done
if [ -x /bin/latency ]; then
	start_daemon uio:/dev/uio0
	latency pmac0 /run/pmac0.sock 500 'guest, by interrupt' | sed 's/^/@@ latency /'
	stop_daemon
	start_daemon mem:0xD4000
	latency pmac0 /run/pmac0.sock 500 'guest, polled' | sed 's/^/@@ latency /'
	stop_daemon
fi
say "value counted $(interrupts)"
say "value interrupts $(awk '$1 == "7:" { print $2 }' /proc/interrupts)"
rmmod pmac_dpram && [ ! -e /dev/uio0 ] && ok 'the driver goes' || fail 'rmmod pmac_dpram'
expect 'and leaves nothing behind' '' "$(grep pmac-dpram /proc/iomem /proc/ioports)"
