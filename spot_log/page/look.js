const tip = document.getElementById('tip');
document.addEventListener('mousemove', e => {
  const at = e.target.closest('[data-t]');
  if (!at) { tip.style.display = 'none'; return; }
  tip.textContent = at.dataset.t; tip.style.display = 'block';
  const w = tip.offsetWidth, h = tip.offsetHeight;
  tip.style.left = Math.max(4, Math.min(e.clientX + 14, innerWidth - w - 6)) + 'px';
  tip.style.top = (e.clientY + h + 24 < innerHeight ? e.clientY + 16 : e.clientY - h - 10) + 'px';
});
