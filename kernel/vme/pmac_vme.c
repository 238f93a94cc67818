// SPDX-License-Identifier: GPL-2.0
/*
 * UIO devices for PMAC motion controllers in a VME crate: the bridge's windows onto dual-ported RAM and mailboxes, and
 * the card's three interrupt vectors. A VME bus driver of the kernel (vme_tsi148) has to be loaded before.
 *
 *   modprobe pmac_vme dpram=0x700000 mailbox=0x7fa000 level=2 vector=0xa1
 *   modprobe pmac_vme dpram=0x700000,0x710000 mailbox=0x7fa000,0x7fa200 level=2,2 vector=0xa1,0xb1
 *
 * The values are those of the card's own setup (X:$0783 to X:$078C, Turbo I90 to I99): "pmacctl setup vme" explains
 * them. "bits" is the width of the card's addresses, 24 unless given.
 *
 * Card N has three UIO devices. Each counts one vector, so that user space tells the vectors apart:
 *
 *   pmac-vmeN-taken | v-1 | the card has taken a group of characters out of the mailboxes
 *   pmac-vmeN-reply | v   | the mailboxes hold a group of a reply
 *   pmac-vmeN       | v+1 | the DPRAM holds a response; map 0 is the DPRAM, map 1 the mailboxes
 *
 * A card shows 16 KiB of its DPRAM, once the host has written address bits A19-A14 to the page register among the
 * mailboxes, after each reset. User space writes them: only user space sees a reset.
 *
 * Maps: "addr" is the VME address at which the bridge's window begins, not an address of the processor, and "offset"
 * is where in the window the card's memory begins. A bridge has windows of 64 KiB at multiples of 64 KiB. Whoever opens
 * the device could reach the other cards in these; the shipped udev rule gives the node to user pmacd alone.
 *
 * Interrupt: the bridge acknowledges the card on the bus, which gives the vector. Nothing has to be armed again; the
 * device accepts a 1 for programs that arm. The kernel reports a vector that nobody asked for as spurious.
 *
 * Removal: while the device is open this module stays. The bridge's driver may go all the same, and its windows with it;
 * then the maps end, and a program's next access ends the program, before another card could lie there.
 *
 * Windows: a card takes two. A Tsi148 has eight, so four cards; vme_user takes four of them, so two cards beside it.
 *
 * Tested with the kernel's vme_fake bridge, patched to show a simulated card, and Linux 6.1 and 6.12; DKMS ran once, by
 * hand, for 6.1. UNTESTED: hardware (no Tsi148 and no card was there), two cards at work, bits=16, bits=32. Linux has
 * dropped its driver for the Universe II: with that bridge this module has no bus.
 */
#define pr_fmt(fmt)	KBUILD_MODNAME ": " fmt

#include <linux/device.h>
#include <linux/fs.h>
#include <linux/mm.h>
#include <linux/module.h>
#include <linux/sizes.h>
#include <linux/uio_driver.h>

#include "vme.h"

#define PMAC_NAME	"pmac_vme"
#define PMAC_VERSION	"0.1.0"
#define PMAC_CARDS	4

/* What a card shows of its DPRAM, and its mailboxes. */
#define PMAC_DPRAM	SZ_16K
#define PMAC_MAILBOX	SZ_512

/* How the card wants to be reached: words or bytes, one a cycle, as data of a user (address modifier $39, $29 or $09). */
#define PMAC_CYCLE	(VME_SCT | VME_USER | VME_DATA)
#define PMAC_WIDTH	VME_D16

static unsigned int dpram[PMAC_CARDS];
static unsigned int cards;
/* VME addresses, levels and vectors are none of the host's: a kernel that is locked down may take them. */
module_param_array(dpram, uint, &cards, 0444);
MODULE_PARM_DESC(dpram, "VME address of each card's DPRAM");

static unsigned int mailbox[PMAC_CARDS];
static unsigned int mailboxes;
module_param_array(mailbox, uint, &mailboxes, 0444);
MODULE_PARM_DESC(mailbox, "VME address of each card's mailboxes");

static unsigned int level[PMAC_CARDS];
module_param_array(level, uint, NULL, 0444);
MODULE_PARM_DESC(level, "interrupt level of each card, 1 to 7");

static unsigned int vector[PMAC_CARDS];
module_param_array(vector, uint, NULL, 0444);
MODULE_PARM_DESC(vector, "vector v of each card, odd, 1 to 253; the card uses v-1 and v+1 too");

static unsigned int bits[PMAC_CARDS] = { [0 ... PMAC_CARDS - 1] = 24 };
module_param_array(bits, uint, NULL, 0444);
MODULE_PARM_DESC(bits, "width of each card's addresses: 16, 24 or 32 (default 24)");

/* A UIO device, and the vector it counts once it is there. */
struct pmac_vector {
	struct uio_info info;
	bool live;
};

struct pmac_window {
	struct vme_resource *resource;
	u32 space;
};

struct pmac_card {
	struct vme_dev *vdev;
	struct pmac_window windows[2];		/* as the maps of the UIO device: DPRAM, mailboxes */
	struct pmac_vector vectors[3];		/* v-1, v, v+1 */
	unsigned int requested;			/* of the vectors, from the first on */
	struct inode *inode;			/* of the device's node, while it is open */
	unsigned int opened;			/* how often; UIO serialises open and release */
};

/* The cards found, why the last of those that failed did, and whether a UIO device has ever been there to be opened. */
static unsigned int pmac_found;
static int pmac_error;
static bool pmac_public;
static bool pmac_registered;

static void pmac_interrupt(int level, int vector, void *data)
{
	struct pmac_vector *v = data;

	/* vme_irq_free takes the handler away, then its data: a vector between the two comes without. */
	if (v && smp_load_acquire(&v->live))
		uio_event_notify(&v->info);
}

static int pmac_irqcontrol(struct uio_info *info, s32 on)
{
	return on ? 0 : -EOPNOTSUPP;
}

static int pmac_open(struct uio_info *info, struct inode *inode)
{
	struct pmac_card *card = info->priv;

	/* The maps of a second inode would outlive the windows. */
	if (card->inode && card->inode != inode)
		return -EBUSY;
	if (!card->opened++) {
		ihold(inode);
		card->inode = inode;
	}
	return 0;
}

/* A map holds its file open. Later than the last close the node's file system may go, which the inode does not hold. */
static int pmac_release(struct uio_info *info, struct inode *inode)
{
	struct pmac_card *card = info->priv;

	if (!--card->opened) {
		card->inode = NULL;
		iput(inode);
	}
	return 0;
}

/* After the UIO device has gone, and before its windows do: nobody can map them again. */
static void pmac_end_maps(void *data)
{
	struct pmac_card *card = data;

	if (!card->inode)
		return;
	unmap_mapping_range(card->inode->i_mapping, 0, 0, 1);
	iput(card->inode);
}

/* UIO has checked the length. The place in the file is the map's number; the map is mapped from the window's start. */
static int pmac_mmap(struct uio_info *info, struct vm_area_struct *vma)
{
	struct pmac_card *card = info->priv;
	unsigned long map = vma->vm_pgoff;

	vma->vm_pgoff = 0;
	return vme_master_mmap(card->windows[map].resource, vma);
}

static void pmac_close_window(void *data)
{
	struct pmac_window *window = data;

	vme_master_set(window->resource, 0, 0, 0, window->space, PMAC_CYCLE, PMAC_WIDTH);
	vme_master_free(window->resource);
}

/* A window of the bridge onto the 64 KiB that hold "size" bytes at "address", and the map of a UIO device for them. */
static int pmac_open_window(struct device *dev, struct pmac_window *window, struct uio_mem *mem, const char *name,
			    unsigned int address, unsigned int size)
{
	struct vme_dev *vdev = container_of(dev, struct vme_dev, dev);
	int err;

	mem->name = name;
	mem->addr = address & ~(SZ_64K - 1);
	mem->offs = address & (SZ_64K - 1);
	mem->size = PAGE_ALIGN(mem->offs + size);
	window->resource = vme_master_request(vdev, window->space, PMAC_CYCLE, PMAC_WIDTH);
	if (!window->resource)
		return dev_err_probe(dev, -EBUSY, "the bridge has no more window for %s=%#x\n", name, address);
	err = devm_add_action_or_reset(dev, pmac_close_window, window);
	if (err)
		return err;
	err = vme_master_set(window->resource, 1, mem->addr, SZ_64K, window->space, PMAC_CYCLE, PMAC_WIDTH);
	if (err)
		return dev_err_probe(dev, err, "the bridge cannot reach %s=%#x\n", name, address);
	return 0;
}

static void pmac_free_vectors(void *data)
{
	struct pmac_card *card = data;
	int n = card->vdev->num;

	while (card->requested)
		vme_irq_free(card->vdev, level[n], vector[n] - 1 + --card->requested);
	/* A bridge calls handlers in interrupts, their threads and bottom halves: RCU readers all of them. */
	synchronize_rcu();
}

static int pmac_request_vectors(struct pmac_card *card)
{
	int n = card->vdev->num;
	int i, err;

	for (i = 0; i < ARRAY_SIZE(card->vectors); i++) {
		err = vme_irq_request(card->vdev, level[n], vector[n] - 1 + i, pmac_interrupt, &card->vectors[i]);
		if (err)
			return dev_err_probe(&card->vdev->dev, err, "level %u, vector %#x cannot be had\n", level[n],
					     vector[n] - 1 + i);
		card->requested++;
	}
	return 0;
}

static int pmac_register_devices(struct pmac_card *card)
{
	struct device *dev = &card->vdev->dev;
	int i, err;

	/* The device with the maps comes last: the service that udev starts for it finds the others. */
	for (i = 0; i < ARRAY_SIZE(card->vectors); i++) {
		struct pmac_vector *v = &card->vectors[i];

		v->info.version = PMAC_VERSION;
		v->info.irq = UIO_IRQ_CUSTOM;
		v->info.irqcontrol = pmac_irqcontrol;
		/* A program may open it before the call returns. */
		pmac_public = true;
		err = devm_uio_register_device(dev, &v->info);
		if (err)
			return dev_err_probe(dev, err, "no UIO device %s\n", v->info.name);
		smp_store_release(&v->live, true);
	}
	return 0;
}

static int pmac_add_card(struct vme_dev *vdev)
{
	static const char * const names[] = { "pmac-vme%d-taken", "pmac-vme%d-reply", "pmac-vme%d" };
	struct device *dev = &vdev->dev;
	struct pmac_card *card;
	struct uio_info *info;
	int n = vdev->num;
	u32 space;
	int i, err;

	/* pmac_init has checked the parameters. */
	space = bits[n] == 16 ? VME_A16 : bits[n] == 24 ? VME_A24 : VME_A32;
	card = devm_kzalloc(dev, sizeof(*card), GFP_KERNEL);
	if (!card)
		return -ENOMEM;
	card->vdev = vdev;
	for (i = 0; i < ARRAY_SIZE(card->vectors); i++) {
		info = &card->vectors[i].info;
		info->name = devm_kasprintf(dev, GFP_KERNEL, names[i], n);
		if (!info->name)
			return -ENOMEM;
	}
	/* The last has the maps. */
	info->priv = card;
	info->open = pmac_open;
	info->release = pmac_release;
	info->mmap = pmac_mmap;
	for (i = 0; i < ARRAY_SIZE(card->windows); i++)
		card->windows[i].space = space;
	err = pmac_open_window(dev, &card->windows[0], &info->mem[0], "dpram", dpram[n], PMAC_DPRAM);
	if (!err)
		err = pmac_open_window(dev, &card->windows[1], &info->mem[1], "mailbox", mailbox[n], PMAC_MAILBOX);
	if (!err)
		err = devm_add_action_or_reset(dev, pmac_end_maps, card);
	if (err)
		return err;
	/* The bridge may refuse a vector, so they come before the first device. They go before the devices, too. */
	err = pmac_request_vectors(card);
	if (!err)
		err = pmac_register_devices(card);
	if (!err)
		err = devm_add_action(dev, pmac_free_vectors, card);
	if (err)
		pmac_free_vectors(card);
	else
		dev_info(dev, "uio%d: A%u, DPRAM %#x, mailboxes %#x, level %u, vectors %#x to %#x\n",
			 info->uio_dev->minor, bits[n], dpram[n], mailbox[n], level[n], vector[n] - 1, vector[n] + 1);
	return err;
}

static int pmac_probe(struct vme_dev *vdev)
{
	int err = pmac_add_card(vdev);

	pmac_found++;
	if (err)
		pmac_error = err;
	return err;
}

/* The parameters describe the cards of the first bus: no machine with two is known. */
static int pmac_match(struct vme_dev *vdev)
{
	return !vme_bus_num(vdev);
}

static struct vme_driver pmac_driver = {
	.name = PMAC_NAME,
	.match = pmac_match,
	.probe = pmac_probe,
};

static int __init pmac_check_address(unsigned int n, const char *name, unsigned int address, unsigned int size)
{
	if (address % size)
		pr_err("card %u: %s=%#x is no multiple of %#x\n", n, name, address, size);
	else if (address + (u64)size > 1ULL << bits[n])
		pr_err("card %u: %s=%#x is out of reach of %u bits of address\n", n, name, address, bits[n]);
	else
		return 0;
	return -EINVAL;
}

static int __init pmac_check(unsigned int n)
{
	unsigned int other;

	if (bits[n] != 16 && bits[n] != 24 && bits[n] != 32) {
		pr_err("card %u: bits=%u: a card takes 16, 24 or 32 bits of address\n", n, bits[n]);
		return -EINVAL;
	}
	if (level[n] < 1 || level[n] > 7) {
		pr_err("card %u: level=%u: a VME bus has levels 1 to 7\n", n, level[n]);
		return -EINVAL;
	}
	if (!(vector[n] & 1) || vector[n] > 253) {
		pr_err("card %u: vector=%#x: a card takes v-1, v and v+1, with an odd v from 0x01 to 0xfd\n", n, vector[n]);
		return -EINVAL;
	}
	for (other = 0; other < n; other++) {
		if (level[other] == level[n] && abs((int)vector[other] - (int)vector[n]) < 3) {
			pr_err("cards %u and %u share a vector\n", other, n);
			return -EINVAL;
		}
	}
	return pmac_check_address(n, "dpram", dpram[n], PMAC_DPRAM) ?:
	       pmac_check_address(n, "mailbox", mailbox[n], PMAC_MAILBOX);
}

/*
 * Loading fails as long as nobody can have opened a device: the operator has to notice. Later it must not: the kernel
 * frees a module that fails even while a program uses it. Then the cards that work stay, and the log tells of others.
 */
static int __init pmac_init(void)
{
	unsigned int n;
	int err;

	if (!cards || mailboxes != cards) {
		pr_err("each card needs dpram, mailbox, level and vector\n");
		return -EINVAL;
	}
	for (n = 0; n < cards; n++) {
		err = pmac_check(n);
		if (err)
			return err;
	}
	err = vme_register_driver(&pmac_driver, cards);
	pmac_registered = !err;
	if (!err && !pmac_found) {
		pr_err("there is no VME bus: load the bridge's driver first\n");
		pmac_error = -ENODEV;
	}
	if (!err)
		err = pmac_error;
	if (err && pmac_public) {
		pr_err("not every card works, see above; the module stays for those that do\n");
		return 0;
	}
	if (err && pmac_registered)
		vme_unregister_driver(&pmac_driver);
	return err;
}

static void __exit pmac_exit(void)
{
	if (pmac_registered)
		vme_unregister_driver(&pmac_driver);
}

module_init(pmac_init);
module_exit(pmac_exit);
MODULE_SOFTDEP("pre: vme_tsi148");
MODULE_LICENSE("GPL");
MODULE_VERSION(PMAC_VERSION);
MODULE_DESCRIPTION("UIO windows and vectors of a PMAC in a VME crate");
