// What the browser remembers of a person's choices. Without a storage, they last as long as the page.
window.remembered = {
  get(name, otherwise) {
    try {
      return localStorage.getItem(`bt_jax-${name}`) ?? otherwise;
    } catch {
      return otherwise;
    }
  },
  set(name, value) {
    try {
      localStorage.setItem(`bt_jax-${name}`, value);
    } catch {
      // as above
    }
  },
};
