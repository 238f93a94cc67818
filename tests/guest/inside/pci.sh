# A PCI board in two pieces: its DPRAM a memory BAR (an ivshmem device), its interrupt INTx of a device with a level that the test's
# host raises and lowers (QEMU's edu), bound to the kernel's own uio_pci_generic. That driver masks INTx at each interrupt.
modprobe -a uio_pci_generic
memory=$(pci_device 0x1af4 0x1110)
interrupt=$(pci_device 0x1234 0x11e8)
bind_generic "$interrupt"
expect 'UIO name' uio_pci_generic "$(cat /sys/class/uio/uio0/name)"
say "value edu $(head -n 1 "$interrupt/resource" | cut -d' ' -f1)"


spec=pci:${memory##*/},bar=2,irq=uio:/dev/uio0
functions pci "$spec"
many "$(argument lines)"
pmacctl --socket /run/pmac0.sock status | sed 's/^/   /'
stop_daemon
complaints
say "value interrupts $(interrupts)"
grep uio /proc/interrupts
