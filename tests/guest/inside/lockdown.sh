# A kernel that is locked down after the board was found, as one with Secure Boot is from the start.
place_dpram
modprobe -a uio_pci_generic
# No parameter: window, interrupt, ports and controller are the firmware's to say, and udev would load it by this name.
modprobe "$(cat /sys/bus/acpi/devices/PMAC0001:00/modalias)" || fail 'modprobe by ACPI'
expect 'UIO name' pmac-dpram "$(cat /sys/class/uio/uio0/name)"
dmesg | grep -q 'pmac-dpram PMAC0001:00: .*level [0-9]*, controller pmac$' && ok 'described by ACPI, a level' || { fail 'not as ACPI describes it'; dmesg | tail -n 5; }
memory=$(pci_device 0x1af4 0x1110)
interrupt=$(pci_device 0x1234 0x11e8)
bind_generic "$interrupt"
# As after its first interrupt: INTx masked.
config "$interrupt" 5 '\x04'
echo integrity >/sys/kernel/security/lockdown || fail 'the kernel has no lockdown'
expect_in lockdown '[integrity]' "$(cat /sys/kernel/security/lockdown)"

refused '/dev/mem' mem:0xD4000 'the kernel is locked down (mode integrity'
refused 'a BAR by sysfs' "pci:${memory##*/},bar=2" 'the kernel is locked down (mode integrity'

# What a driver offers stays: the window, and its interrupt.
start_daemon uio:/dev/uio0
many "$(argument lines)"
stop_daemon
complaints
say "value interrupts $(interrupts)"

# To let uio_pci_generic's next interrupt come, its device's configuration would have to be written.
start_daemon uio:/dev/uio0,irq=uio:/dev/uio1
expect_in 'INTx cannot be armed' 'locked down (mode integrity' "$(grep -i 'armed' /run/pmacd.log)"
pmacctl --socket /run/pmac0.sock send '#1J=100' && wait_for 10 sh -c 'pmacctl --socket /run/pmac0.sock send "#1P" | grep -qx 100' && ok 'replies are polled for' ||
	fail 'no replies without the interrupt'
stop_daemon
