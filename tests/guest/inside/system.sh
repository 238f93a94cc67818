# The way into a Debian with systemd and udev: its disk, and on.
modprobe -a virtio_pci virtio_blk ext4 crc32c_generic
wait_for 10 test -b /dev/vda || fail 'no disk'
mkdir -p /disk
mount -t ext4 /dev/vda /disk || fail 'the disk has no system'
mount --move /dev /disk/dev
umount /sys/kernel/security /sys /run /proc
exec switch_root /disk /lib/systemd/systemd
