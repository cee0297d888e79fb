// SPDX-License-Identifier: GPL-2.0
/*
 * For tests only: puts a real CAN controller's driver into an error state, which no emulated controller gets into by itself.
 *   echo "can1 bus-off" > /proc/can_inject        also: warning, passive, active
 */
#include <linux/can/dev.h>
#include <linux/can/error.h>
#include <linux/if_arp.h>
#include <linux/module.h>
#include <linux/netdevice.h>
#include <linux/proc_fs.h>
#include <linux/rtnetlink.h>
#include <linux/uaccess.h>
#include <net/rtnetlink.h>

struct injection {
	const char *name;
	enum can_state state;
	u8 errors;
};

static const struct injection injections[] = {
	{ "active", CAN_STATE_ERROR_ACTIVE, 0 },
	{ "warning", CAN_STATE_ERROR_WARNING, 100 },
	{ "passive", CAN_STATE_ERROR_PASSIVE, 130 },
	{ "bus-off", CAN_STATE_BUS_OFF, 0 },
};

static const struct injection *find_injection(const char *name)
{
	size_t i;

	for (i = 0; i < ARRAY_SIZE(injections); i++)
		if (!strcmp(injections[i].name, name))
			return &injections[i];
	return NULL;
}

static bool has_controller(const struct net_device *device)
{
	return device && device->type == ARPHRD_CAN && device->rtnl_link_ops &&
	       !strcmp(device->rtnl_link_ops->kind, "can") && netif_running(device);
}

/* With the RTNL lock, as drivers hold it where they change state. */
static int inject(const char *interface_name, const struct injection *wanted)
{
	struct net_device *device = __dev_get_by_name(&init_net, interface_name);
	struct can_priv *controller;
	struct can_frame *frame;
	struct sk_buff *buffer;

	if (!has_controller(device))
		return -ENODEV;
	controller = netdev_priv(device);
	if (controller->state == wanted->state)
		return 0;
	buffer = alloc_can_err_skb(device, &frame);
	if (!buffer)
		return -ENOMEM;
	frame->data[6] = wanted->errors;
	frame->data[7] = wanted->errors;
	can_change_state(device, frame, wanted->state, wanted->state);
	if (wanted->state == CAN_STATE_BUS_OFF)
		can_bus_off(device);
	netif_rx(buffer);
	return 0;
}

static ssize_t inject_write(struct file *file, const char __user *from, size_t size, loff_t *offset)
{
	char text[64], interface_name[IFNAMSIZ + 1], state[16];
	const struct injection *wanted;
	int error;

	if (size >= sizeof(text) || copy_from_user(text, from, size))
		return -EFAULT;
	text[size] = 0;
	if (sscanf(text, "%16s %15s", interface_name, state) != 2)
		return -EINVAL;
	wanted = find_injection(state);
	if (!wanted)
		return -EINVAL;
	rtnl_lock();
	error = inject(interface_name, wanted);
	rtnl_unlock();
	return error ? error : (ssize_t)size;
}

static const struct proc_ops operations = { .proc_write = inject_write };

static int __init inject_init(void)
{
	return proc_create("can_inject", 0200, NULL, &operations) ? 0 : -ENOMEM;
}

static void __exit inject_exit(void)
{
	remove_proc_entry("can_inject", NULL);
}

module_init(inject_init);
module_exit(inject_exit);
MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("Injects CAN controller states, for tests");
