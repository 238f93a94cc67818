// SPDX-License-Identifier: GPL-2.0
/*
 * UIO device for the dual-ported RAM of a PMAC motion controller on an ISA bus: a window of physical memory and one
 * interrupt, as /dev/uioN named "pmac-dpram". PCI boards do not need this module: uio_pci_generic serves them. A VME
 * card needs pmac_vme (vme/), because only the bridge's driver acknowledges an interrupt on the VME bus.
 *
 *   modprobe pmac_dpram phys=0xd4000 irq=7
 *   modprobe pmac_dpram phys=0xd4000,0xd8000 irq=7,5 ioport=0x210,0x220 controller=pmac,pmac2
 *
 * or an ACPI device with _HID "PMAC0001", or a devicetree node compatible with "delta-tau,pmac-dpram", either with the
 * window, the interrupt and the ports as its resources, and "delta-tau,controller" with a value of the parameter below.
 *
 * Node: /dev/uioN belongs to root alone until a udev rule changes that. The shipped rule gives it to user pmacd, mode
 * 0600: whoever opens it can write to the board past every role of the daemon's socket, so no group should have access.
 *
 * Window: UIO maps whole pages. A window that starts inside a page (a VME page at $x4000 never does, a 4 KiB piece of
 * one might on a machine with larger pages) is mapped from the page's start; maps/map0/offset gives its offset. An
 * address below 1 MiB that the firmware marked reserved counts as taken; "reserved=1" uses it anyway. Pages that hold
 * any of the system's RAM are refused in any case: whoever maps the device could write to the kernel.
 *
 * Lockdown: a kernel that is locked down (Secure Boot) refuses "phys", "irq" and "ioport". A board that the firmware
 * describes needs none of them.
 *
 * Interrupt: an edge (ISA) is only counted. A level (some ISA machines) is masked here until user space
 * has served the board and writes 1 to the device, because only the board can release the line. For both kinds, writing
 * 0 masks and writing 1 unmasks.
 *
 * Controller: between the DPRAM's interrupt and the host's line is the board's own interrupt controller, at its host
 * port's base + 8. With "ioport" and "controller", this module unmasks the controller's line while the device is open,
 * and sends an end of interrupt after each interrupt. An 8259 in edge mode accepts that while its input is still high:
 * it waits for the next rising edge. No document says how a PMAC(1) sets up its 8259 at power-on; "init8259=1" writes
 * ICW1, ICW2 and ICW4 first.
 *
 *           | PMAC(1), an 8259                       | PMAC2
 *   base+8  | 0x67: specific end of interrupt, line 7 | latched lines, a 1 clears: bit 5
 *   base+9  | mask, 1 = masked                       | present state of the lines
 *   base+10 | -                                      | mask, 1 = unmasked
 */
#include <linux/bits.h>
#include <linux/device.h>
#include <linux/interrupt.h>
#include <linux/io.h>
#include <linux/ioport.h>
#include <linux/irq.h>
#include <linux/mm.h>
#include <linux/mod_devicetable.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/property.h>
#include <linux/sizes.h>
#include <linux/spinlock.h>
#include <linux/uio_driver.h>

#define PMAC_NAME	"pmac-dpram"
#define PMAC_VERSION	"0.1.0"
#define PMAC_BOARDS	4

/* Offset of the controller's registers from the host port's base. */
#define PMAC_PIC	8
#define PMAC_PIC_SIZE	4

static unsigned long phys[PMAC_BOARDS];
static unsigned int boards;
module_param_hw_array(phys, ulong, iomem, &boards, 0444);
MODULE_PARM_DESC(phys, "physical address of each board's window");

static unsigned long size[PMAC_BOARDS];
module_param_array(size, ulong, NULL, 0444);
MODULE_PARM_DESC(size, "bytes of each window (default 16384)");

static int irq[PMAC_BOARDS];
module_param_hw_array(irq, int, irq, NULL, 0444);
MODULE_PARM_DESC(irq, "interrupt of each board (default 0: none)");

static bool level[PMAC_BOARDS];
module_param_array(level, bool, NULL, 0444);
MODULE_PARM_DESC(level, "the interrupt is a level and stays masked until user space writes 1 (default 0: an edge)");

static unsigned int ioport[PMAC_BOARDS];
module_param_hw_array(ioport, uint, ioport, NULL, 0444);
MODULE_PARM_DESC(ioport, "base of each board's host port, 0x210 as delivered (default 0: none)");

static char *controller[PMAC_BOARDS];
module_param_array(controller, charp, NULL, 0444);
MODULE_PARM_DESC(controller, "interrupt controller behind ioport: pmac (an 8259) or pmac2");

static bool init8259[PMAC_BOARDS];
module_param_array(init8259, bool, NULL, 0444);
MODULE_PARM_DESC(init8259, "initialise a PMAC's 8259 when the device is opened (default 0: leave it as it is)");

static bool reserved;
module_param(reserved, bool, 0444);
MODULE_PARM_DESC(reserved, "use a window although /proc/iomem shows it as taken, as firmware does that reserves it");

/* The DPRAM's line on the board's own interrupt controller. */
struct pmac_controller {
	const char *name;
	u8 end;			/* written to register 0: ends the line's interrupt */
	u8 mask;		/* index of the mask register */
	u8 bit;			/* the line's bit in it */
	bool one_opens;
};

static const struct pmac_controller pmac_controllers[] = {
	{ .name = "pmac",  .end = 0x67,   .mask = 1, .bit = BIT(7), .one_opens = false },
	{ .name = "pmac2", .end = BIT(5), .mask = 2, .bit = BIT(5), .one_opens = true },
};

struct pmac_board {
	struct uio_info info;
	const struct pmac_controller *controller;
	u8 __iomem *pic;	/* NULL without a controller */
	bool init8259;
	unsigned int users;	/* open files; UIO serialises open and release */
	bool level;
	spinlock_t lock;	/* keeps the interrupt out of masked and of the controller */
	bool masked;
};

static void pmac_end(struct pmac_board *board)
{
	unsigned long flags;

	if (!board->pic)
		return;
	spin_lock_irqsave(&board->lock, flags);
	iowrite8(board->controller->end, board->pic);
	spin_unlock_irqrestore(&board->lock, flags);
}

/*
 * Masks every line. An end of interrupt between these bytes would be taken for one of them. Interrupts off: no other
 * driver's handler on this processor draws them out.
 */
static void pmac_init8259(struct pmac_board *board)
{
	unsigned long flags;

	if (!board->pic || !board->init8259)
		return;
	spin_lock_irqsave(&board->lock, flags);
	iowrite8(0x13, board->pic);		/* ICW1: edge mode, single, ICW4 follows */
	iowrite8(0x08, board->pic + 1);		/* ICW2: vectors, not used */
	iowrite8(0x01, board->pic + 1);		/* ICW4: 8086, no automatic end of interrupt */
	iowrite8(0xff, board->pic + 1);		/* initialising has unmasked every line */
	spin_unlock_irqrestore(&board->lock, flags);
}

/* Unmasks or masks only our line: other lines of the controller may have other users. */
static void pmac_open_line(struct pmac_board *board, bool open)
{
	const struct pmac_controller *c = board->controller;
	unsigned long flags;
	u8 mask;

	if (!board->pic)
		return;
	spin_lock_irqsave(&board->lock, flags);
	mask = ioread8(board->pic + c->mask);
	if (open == c->one_opens)
		mask |= c->bit;
	else
		mask &= ~c->bit;
	iowrite8(mask, board->pic + c->mask);
	spin_unlock_irqrestore(&board->lock, flags);
}

static void pmac_mask(struct pmac_board *board, bool mask)
{
	unsigned long flags;

	spin_lock_irqsave(&board->lock, flags);
	if (mask && !board->masked)
		disable_irq_nosync(board->info.irq);
	else if (!mask && board->masked)
		enable_irq(board->info.irq);
	board->masked = mask;
	spin_unlock_irqrestore(&board->lock, flags);
}

static irqreturn_t pmac_interrupt(int number, struct uio_info *info)
{
	struct pmac_board *board = info->priv;

	if (board->level)
		pmac_mask(board, true);
	pmac_end(board);
	return IRQ_HANDLED;
}

static int pmac_irqcontrol(struct uio_info *info, s32 on)
{
	struct pmac_board *board = info->priv;

	/* If the board still held its level at the end of interrupt, the controller has latched it again. */
	if (on && board->level)
		pmac_end(board);
	pmac_mask(board, !on);
	return 0;
}

static int pmac_open(struct uio_info *info, struct inode *inode)
{
	struct pmac_board *board = info->priv;

	if (board->users++)
		return 0;
	pmac_init8259(board);
	pmac_end(board);
	pmac_open_line(board, true);
	return 0;
}

static int pmac_release(struct uio_info *info, struct inode *inode)
{
	struct pmac_board *board = info->priv;

	if (!--board->users)
		pmac_open_line(board, false);
	return 0;
}

/* Removing a device that is open does not call release first. */
static void pmac_shut(void *board)
{
	pmac_open_line(board, false);
}

static int pmac_find_window(struct device *dev, struct uio_mem *mem, struct resource *window)
{
	mem->name = "dpram";
	mem->memtype = UIO_MEM_PHYS;
	mem->addr = window->start & PAGE_MASK;
	mem->offs = window->start & ~PAGE_MASK;
	mem->size = PAGE_ALIGN(mem->offs + resource_size(window));
	/* The pages, not the window: user space gets all of each. */
	if (region_intersects(mem->addr, mem->size, IORESOURCE_SYSTEM_RAM, IORES_DESC_NONE) != REGION_DISJOINT)
		return dev_err_probe(dev, -EINVAL, "%pR is in pages of the system's RAM, see /proc/iomem\n", window);
	if (!devm_request_mem_region(dev, window->start, resource_size(window), PMAC_NAME)) {
		if (!reserved)
			return dev_err_probe(dev, -EBUSY,
				"%pR is taken, /proc/iomem says by whom; if firmware only reserved it, reserved=1\n", window);
		dev_warn(dev, "%pR is taken and used all the same\n", window);
	}
	return 0;
}

static int pmac_find_controller(struct device *dev, struct pmac_board *board, struct resource *ports)
{
	const char *name = NULL;
	unsigned int i;

	device_property_read_string(dev, "delta-tau,controller", &name);
	if (!ports && !name)
		return 0;
	if (!ports || !name)
		return dev_err_probe(dev, -EINVAL, "ioport and controller go together, one of them is missing\n");
	for (i = 0; i < ARRAY_SIZE(pmac_controllers); i++)
		if (!strcmp(name, pmac_controllers[i].name))
			board->controller = &pmac_controllers[i];
	if (!board->controller)
		return dev_err_probe(dev, -EINVAL, "there is no controller \"%s\", only pmac and pmac2\n", name);
	board->init8259 = device_property_read_bool(dev, "delta-tau,init8259");
	if (!devm_request_region(dev, ports->start + PMAC_PIC, PMAC_PIC_SIZE, PMAC_NAME))
		return dev_err_probe(dev, -EBUSY, "ports %pR are taken, see /proc/ioports\n", ports);
	board->pic = devm_ioport_map(dev, ports->start + PMAC_PIC, PMAC_PIC_SIZE);
	if (!board->pic)
		return dev_err_probe(dev, -ENOMEM, "ports %pR cannot be reached\n", ports);
	return devm_add_action_or_reset(dev, pmac_shut, board);
}

static int pmac_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct resource *window = platform_get_resource(pdev, IORESOURCE_MEM, 0);
	struct resource *ports = platform_get_resource(pdev, IORESOURCE_IO, 0);
	struct pmac_board *board;
	struct uio_info *info;
	int number, err;

	if (!window)
		return dev_err_probe(dev, -EINVAL, "no memory window is described\n");
	board = devm_kzalloc(dev, sizeof(*board), GFP_KERNEL);
	if (!board)
		return -ENOMEM;
	spin_lock_init(&board->lock);
	info = &board->info;
	info->name = PMAC_NAME;
	info->version = PMAC_VERSION;
	info->priv = board;
	info->open = pmac_open;
	info->release = pmac_release;
	err = pmac_find_window(dev, &info->mem[0], window);
	if (err)
		return err;
	err = pmac_find_controller(dev, board, ports);
	if (err)
		return err;

	number = platform_get_irq_optional(pdev, 0);
	if (number == -ENXIO) {
		info->irq = UIO_IRQ_NONE;
	} else if (number < 0) {
		return dev_err_probe(dev, number, "its interrupt cannot be used\n");
	} else {
		info->irq = number;
		info->handler = pmac_interrupt;
		info->irqcontrol = pmac_irqcontrol;
		board->level = irq_get_trigger_type(number) & IRQ_TYPE_LEVEL_MASK;
	}
	err = devm_uio_register_device(dev, info);
	if (err)
		return dev_err_probe(dev, err, "no UIO device for %pR, interrupt %d\n", window, number);
	dev_info(dev, "uio%d: %pR, %s %d, controller %s\n", info->uio_dev->minor, window,
		 board->level ? "level" : "edge", (int)info->irq, board->pic ? board->controller->name : "none");
	return 0;
}

static const struct acpi_device_id pmac_acpi[] = {
	{ "PMAC0001" },
	{ }
};
MODULE_DEVICE_TABLE(acpi, pmac_acpi);

static const struct of_device_id pmac_of[] = {
	{ .compatible = "delta-tau,pmac-dpram" },
	{ }
};
MODULE_DEVICE_TABLE(of, pmac_of);

static struct platform_driver pmac_driver = {
	.probe = pmac_probe,
	.driver = {
		.name = PMAC_NAME,
		.acpi_match_table = pmac_acpi,
		.of_match_table = pmac_of,
	},
};

/* The boards that the parameters describe. */
static struct platform_device *pmac_devices[PMAC_BOARDS];

static struct platform_device *pmac_add(unsigned int i)
{
	struct property_entry properties[3] = { };
	struct resource resources[3] = { };
	struct platform_device_info info = {
		.name = PMAC_NAME,
		.id = i,
		.res = resources,
		.properties = properties,
	};
	unsigned int p = 0;

	resources[info.num_res++] = (struct resource)DEFINE_RES_MEM(phys[i], size[i] ? size[i] : SZ_16K);
	if (irq[i] > 0) {
		unsigned long kind = level[i] ? IORESOURCE_IRQ_HIGHLEVEL : IORESOURCE_IRQ_HIGHEDGE;

		resources[info.num_res++] = (struct resource)DEFINE_RES_NAMED(irq[i], 1, NULL, IORESOURCE_IRQ | kind);
	}
	if (ioport[i])
		resources[info.num_res++] = (struct resource)DEFINE_RES_IO(ioport[i], 16);
	if (controller[i])
		properties[p++] = PROPERTY_ENTRY_STRING("delta-tau,controller", controller[i]);
	if (init8259[i])
		properties[p++] = PROPERTY_ENTRY_BOOL("delta-tau,init8259");
	return platform_device_register_full(&info);
}

static void pmac_remove_all(void)
{
	unsigned int i;

	for (i = 0; i < PMAC_BOARDS; i++)
		platform_device_unregister(pmac_devices[i]);
	platform_driver_unregister(&pmac_driver);
}

/* Loading fails if any board of the parameters fails: the operator has to notice. */
static int __init pmac_init(void)
{
	unsigned int i;
	int err;

	err = platform_driver_register(&pmac_driver);
	if (err)
		return err;
	for (i = 0; i < boards; i++) {
		struct platform_device *device = pmac_add(i);

		if (IS_ERR(device)) {
			err = PTR_ERR(device);
			goto remove;
		}
		pmac_devices[i] = device;
		if (!device->dev.driver) {
			err = -ENODEV;
			goto remove;
		}
	}
	return 0;

remove:
	pmac_remove_all();
	return err;
}

static void __exit pmac_exit(void)
{
	pmac_remove_all();
}

module_init(pmac_init);
module_exit(pmac_exit);
MODULE_LICENSE("GPL");
MODULE_VERSION(PMAC_VERSION);
MODULE_DESCRIPTION("UIO window and interrupt of a PMAC's dual-ported RAM on an ISA bus");
