// SPDX-License-Identifier: GPL-2.0
/*
 * What turns the kernel's vme_fake, into which it is included, from a bus without cards into one with a simulated card:
 *
 *   memory=ADDRESS      the processor's address of the A24 space's last MiB but modulo 1 MiB: a window maps what is there
 *   pins=3,6,7          the host's interrupts that stand for the card's vectors, from "first" on; each is an edge
 *   iack=0x218          I/O ports, one a vector, where the acknowledge of an interrupt shows
 *   generate=0xLVV      written to: level L with vector VV, by the bridge's own generator
 */
#include <linux/io.h>

static unsigned long memory;
module_param(memory, ulong, 0444);
static unsigned int level = 2;
module_param(level, uint, 0444);
static unsigned int first = 0xa0;
module_param(first, uint, 0444);
static int pins[3];
static unsigned int pin_count;
module_param_array(pins, int, &pin_count, 0444);

static unsigned int iack = 0x218;
module_param(iack, uint, 0444);

static int machine_master_set(struct vme_master_resource *image, int enabled, unsigned long long vme_base,
			      unsigned long long size, u32 aspace, u32 cycle, u32 dwidth)
{
	int err = fake_master_set(image, enabled, vme_base, size, aspace, cycle, dwidth);

	memset(&image->bus_resource, 0, sizeof(image->bus_resource));
	/* A card answers to its own modifier and no other. */
	if (!err && enabled && aspace == VME_A24 && dwidth == VME_D16 && cycle == (VME_SCT | VME_USER | VME_DATA)) {
		image->bus_resource.start = memory + (vme_base & 0xfffff);
		image->bus_resource.end = image->bus_resource.start + size - 1;
	}
	return err;
}

static int machine_generate(const char *text, const struct kernel_param *parameter)
{
	unsigned int what;
	int err = kstrtouint(text, 0, &what);

	return err ? err : fake_irq_generate(exit_pointer, what >> 8, what & 0xff);
}

static const struct kernel_param_ops machine_generate_ops = { .set = machine_generate };
module_param_cb(generate, &machine_generate_ops, NULL, 0200);

static irqreturn_t machine_pin(int pin, void *vector)
{
	outb(0, iack + (unsigned long)vector - first);
	vme_irq_handler(exit_pointer, level, (unsigned long)vector);
	return IRQ_HANDLED;
}

static void machine_end(void)
{
	while (pin_count--)
		free_irq(pins[pin_count], (void *)(unsigned long)(first + pin_count));
}

static int machine_begin(void)
{
	unsigned int i;

	for (i = 0; i < pin_count; i++)
		if (request_irq(pins[i], machine_pin, 0, "vme_fake", (void *)(unsigned long)(first + i)))
			pr_err("vme_fake: interrupt %d cannot be had\n", pins[i]);
	return 0;
}
